"""railctl levels, from the command line to the files."""

import json
from pathlib import Path

import numpy as np
import pytest
from msgpack._cmsgpack import Packer
from PIL import Image
from typer.testing import CliRunner

from railctl.common.levels import files
from railctl.common.levels.bank import LevelBank
from railctl.common.levels.build import build
from railctl.common.levels.chunks import key_of
from railctl.common.levels.distributions import StockLevels, shipped
from railctl.common.levels.generate import generate as generate_any
from railctl.common.levels.shipped import generate
from railctl.common.levels.supply import LevelSupply
from railctl.common.seeding import evaluation_level_seed, training_level_seed
from railctl.deploy import levels
from railctl.deploy.cli import app

RUN_FILE = """
levels:
  rush: {rules: stock, size: [20, 24], trains: 4, cities: 2, held_out: 3, speeds: {1: 0.5, 0.5: 0.5},
         malfunctions: {rate: 0.002, min_steps: 20, max_steps: 50}}
  mine: {files: "*.npz", evaluation: 0.5}
mix: {rush: 0.5, mine: 0.5}
"""
RUSH = StockLevels.model_validate(
    {
        "rules": "stock",
        "size": [20, 24],
        "trains": 4,
        "cities": 2,
        "held_out": 3,
        "speeds": {1: 0.5, 0.5: 0.5},
        "malfunctions": {"rate": 0.002, "min_steps": 20, "max_steps": 50},
    }
)
RECORDINGS = Path(__file__).parents[2] / "parity" / "data" / "flatland222_episodes_small.npz"


@pytest.fixture
def railctl_in_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The command line as a user has it: what it asks for is done in a process of its own."""
    monkeypatch.setenv("RAILCTL_LEVELS", str(tmp_path / "bank"))

    def run(*arguments: object, code: int = 0) -> str:
        result = CliRunner().invoke(app, ["levels", *map(str, arguments)])
        assert result.exit_code == code, result.output
        return result.stdout if "--json" in arguments else result.output  # with what is said on stderr

    return run


@pytest.fixture
def railctl(railctl_in_processes, tasks_here):
    """The same in this process alone."""
    return railctl_in_processes


def test_a_bank_is_built_and_verified(railctl_in_processes, tmp_path: Path):
    railctl = railctl_in_processes
    command = ("build", "--level", "easy", "--seeds", "3", "--episodes", 6, "--evaluation", 4)
    output = railctl(*command)
    assert "easy: 6 of 6" in output
    bank = LevelBank(tmp_path / "bank")
    wanted = {training_level_seed(3, episode) for episode in range(6)} | set(map(evaluation_level_seed, range(4)))
    assert wanted <= bank.seeds("easy")
    assert json.loads(railctl(*command, "--json"))["built"] == {"easy": 0}
    assert f"no change in {len(bank.seeds('easy'))} levels" in railctl("verify", "--sample", 2)


def test_damage_is_reported_in_one_line(railctl_in_processes, tmp_path: Path):
    railctl = railctl_in_processes
    build(tmp_path / "bank", shipped()["easy"], [3, 4])
    path = next((tmp_path / "bank" / "easy").glob("*.levels"))
    path.write_bytes(path.read_bytes()[:-1])
    assert railctl("verify", code=1).strip() == (
        f"railctl: {path} is not as long as its header says: delete it, then railctl levels build makes it again"
    )


def test_recordings_are_replayed(railctl):
    output = railctl("verify", RECORDINGS)
    assert "episodes: 6 of 6" in output
    assert f"{RECORDINGS}: 6 episodes, 8508 agent-steps, 4841 tree nodes" in output
    assert output.endswith("\nmismatches: position 0, reward 0, status 0, required 0, tree 0\n")
    assert json.loads(railctl("verify", RECORDINGS, "--json")) == {
        "file": str(RECORDINGS),
        "episodes": 6,
        "agent_steps": 8508,
        "tree_nodes": 4841,
        "mismatches": {"position": 0, "reward": 0, "status": 0, "required": 0, "tree": 0},
        "first_mismatch": None,
    }


def test_a_recording_that_differs_fails_and_says_where(railctl, tmp_path: Path):
    path = tmp_path / "bad.npz"
    with np.load(RECORDINGS) as file:
        arrays = dict(file)
    true = arrays["hard_08_trees"][3, 2, 0, 6].item()
    arrays["hard_08_trees"][3, 2, 0, 6] = 99
    arrays["hard_08_positions"][9:11, 5, 1] = 4
    np.savez(path, **arrays)
    output = railctl("verify", path, code=1)
    assert "mismatches: position 2, reward 0, status 0, required 0, tree 1\n" in output
    first = f"the first: episode hard_08, step 3, train 2, node 0, feature 6, tree: recorded 99.0, ours {true}"
    assert output.splitlines()[-1] == first
    document = json.loads(railctl("verify", path, "--json", code=1))
    assert document["mismatches"] == {"position": 2, "reward": 0, "status": 0, "required": 0, "tree": 1}
    assert document["first_mismatch"] == {
        "episode": "hard_08",
        "step": 3,
        "train": 2,
        "field": "tree",
        "recorded": 99.0,
        "ours": true,
        "node": 0,
        "feature": 6,
    }


def test_what_holds_no_recordings_is_refused_in_one_line(railctl, tmp_path: Path):
    path = tmp_path / "levels.npz"
    files.save(path, {"easy": [generate("easy", 1)]})
    assert railctl("verify", path, code=1) == (
        f"railctl: {path} holds levels, not recordings of episodes: railctl levels show draws them\n"
    )
    assert railctl("verify", path, "--sample", 3, code=2) == (
        f"railctl: --sample, --bank and -f are for checking the bank: to replay {path}, leave them out\n"
    )


def test_a_level_is_drawn(railctl, tmp_path: Path):
    picture = tmp_path / "level.png"
    facts = json.loads(railctl("show", "--level", "hard", "--seed", 4, "--output", picture, "--json"))
    assert facts["content_hash"] == generate("hard", 4).content_hash
    assert facts["trains"] == len(facts["distances"]) == 7
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"))
    assert min(pixels.shape[:2]) > 800
    railctl("show", "--output", picture)  # which replaces it
    for colour in ((0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00), (0x3C, 0x3A, 0x36)):  # two trains, and steel
        assert (np.abs(pixels.astype(int) - colour).sum(axis=2) < 12).sum() > 100


def test_levels_go_out_and_come_back(railctl, tmp_path: Path):
    railctl("export", "--level", "medium", "--count", 2, "--output", tmp_path / "pickles")
    pickles = sorted((tmp_path / "pickles").glob("*.pkl"))
    assert [path.name for path in pickles] == ["medium_0000.pkl", "medium_0001.pkl"]
    railctl("import", *pickles, "--group", "medium", "--output", tmp_path / "back.npz")
    railctl("export", "--level", "medium", "--count", 2, "--output", tmp_path / "levels.npz")
    back, direct = (files.load(tmp_path / name) for name in ("back.npz", "levels.npz"))
    expected = [LevelSupply().evaluation("medium", index).content_hash for index in range(2)]
    for groups in (back, direct):
        assert [level.content_hash for level in groups["medium"]] == expected


def test_an_import_says_what_every_file_holds_and_what_it_leaves_out(railctl, tmp_path: Path):
    rails = [[0x0004, 0x0401, 0x0401, 0x0100]]
    old = {"grid": rails, "agents_static": [[[0, 1], 1, [0, 3], 0, {"speed": 0.5}, {"malfunction_rate": 30}]]}
    stopped = {"grid": rails, "agents_static": [[[0, 2], 3, [0, 0]]], "actions": [[1]], "max_episode_steps": 30}
    for name, content in (("old.pkl", old), ("stopped.mpk", stopped)):
        (tmp_path / name).write_bytes(Packer().pack(content))
    paths = tmp_path / "old.pkl", tmp_path / "stopped.mpk"
    output = railctl("import", *paths, "--output", tmp_path / "levels.npz")
    assert output.splitlines() == [
        f"{paths[0]}: 1 level of 1x4_1_train",
        f"{paths[0]}: without a step limit: 44 steps are taken, 8 x (rows + columns + trains / 2)",
        f"{paths[0]}: left out: malfunction rates of their own of 1 train, as 2.0 had them",
        f"{paths[1]}: 1 level of 1x4_1_train",
        f"{paths[1]}: left out: the recorded actions",
        f"{tmp_path / 'levels.npz'}: 2 levels of 1x4_1_train",
    ]
    document = json.loads(railctl("import", *paths, "--output", tmp_path / "again.npz", "--json"))
    assert document["groups"] == {"1x4_1_train": 2}
    assert [(file["file"], len(file["left_out"])) for file in document["files"]] == [
        (str(paths[0]), 2),
        (str(paths[1]), 1),
    ]
    slow, plain = files.load(tmp_path / "levels.npz")["1x4_1_train"]
    assert slow.schedule.speeds.tolist() == [[1, 2]]
    assert (plain.schedule, plain.max_steps) == (None, 30)


def test_levels_of_several_shapes_are_gathered_in_groups_of_their_own(railctl, tmp_path: Path):
    for name in ("easy", "hard"):
        files.save(tmp_path / f"{name}.npz", {"round": [generate(name, 1)]})
    paths = tmp_path / "easy.npz", tmp_path / "hard.npz"
    output = railctl("import", *paths, "--output", tmp_path / "levels.npz")
    assert output.splitlines()[-1] == (
        f"{tmp_path / 'levels.npz'}: 1 level of round_25x25_3_trains, 1 level of round_25x25_7_trains"
    )


def test_what_is_no_level_file_is_refused_in_one_line(railctl, tmp_path: Path):
    path = tmp_path / "text.pkl"
    path.write_text("text")
    assert railctl("import", path, "--output", tmp_path / "levels.npz", code=1) == (
        f"railctl: {path} is neither a pickle nor msgpack of flatland-rl: save it again\n"
    )


def test_training_levels_are_exported_by_run_seed(railctl, tmp_path: Path):
    railctl("export", "--count", 2, "--seed", 5, "--output", tmp_path / "levels.npz")
    expected = [LevelSupply().training("easy", training_level_seed(5, episode)).content_hash for episode in range(2)]
    assert [level.content_hash for level in files.load(tmp_path / "levels.npz")["easy"]] == expected


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (("build", "--level", "eassy"), 2, "--level 'eassy': did you mean easy? known are easy, hard, medium"),
        (("build", "--seeds", "1-"), 2, "--seeds '1-': use a number below 2**31, or two as 1-10, the least first"),
        (("show", "no.npz"), 2, "does not exist"),
        (("verify", "no.npz"), 2, "does not exist"),
        (("show", "--seed", "-1"), 2, "greater than or equal to 0"),
    ],
)
def test_wrong_usage_and_failures_say_what_and_where(railctl, arguments, code: int, text: str):
    assert text in railctl(*arguments, code=code)


@pytest.fixture
def nothing_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What is refused is refused before any work, in a folder with a file of levels and two files more."""
    monkeypatch.chdir(tmp_path)
    files.save(Path("some.npz"), {"easy": [generate("easy", 1)]})
    for name in ("keep.yaml", "keep.npz"):
        Path(name).write_text("mine")
    monkeypatch.setattr(levels, "run_task", lambda *arguments: pytest.fail(f"it works: {arguments}"))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("show", "--output", "keep.yaml"), "--output keep.yaml: use a name that ends with .png"),
        (("show", "--output", "no/a.png"), "--output no/a.png: there is no folder no: make it first"),
        (("show", "--output", "bank.png"), "--output bank.png: it is a folder: give another name"),
        (("export", "--output", "keep.npz"), "--output keep.npz: exists already: give another name"),
        (("export", "--output", "bank.png"), "--output bank.png: exists already: give another name"),
        (("export", "--output", "no/a.npz"), "--output no/a.npz: there is no folder no: make it first"),
        (("import", "some.npz", "--output", "keep.npz"), "--output keep.npz: exists already: give another name"),
        (("import", "some.npz", "--output", "no/a.npz"), "--output no/a.npz: there is no folder no: make it first"),
        (("build", "--bank", "keep.npz"), "--bank keep.npz: it is no folder: give another"),
        (("verify", "--bank", "keep.npz"), "--bank keep.npz: it is no folder: give another"),
    ],
)
def test_what_is_there_stays_there(railctl, nothing_works, arguments, text: str):
    Path("bank.png").mkdir()
    assert railctl(*arguments, code=2) == f"railctl: {text}\n"
    assert Path("keep.npz").read_text() == "mine"


def test_a_bank_that_is_no_folder_is_never_verified(railctl, nothing_works, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("RAILCTL_LEVELS", "keep.npz")
    assert railctl("verify", code=2) == "railctl: RAILCTL_LEVELS keep.npz: it is no folder: give another\n"


@pytest.mark.parametrize("verb", ["show", "export", "build", "verify"])
def test_a_bank_or_a_working_directory_that_is_no_text_is_refused(
    railctl, nothing_works, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, verb: str
):
    monkeypatch.setenv("RAILCTL_LEVELS", "b\udcfc")
    problem = "its name is not UTF-8: use another folder\n"
    assert railctl(verb, code=2) == f"railctl: RAILCTL_LEVELS b\\udcfc: {problem}"
    monkeypatch.delenv("RAILCTL_LEVELS")
    Path("b\udcfc").mkdir()
    monkeypatch.chdir("b\udcfc")
    for bank in (), ("--bank", tmp_path):
        said = railctl(verb, *bank, code=2)
        assert said == f"railctl: the working directory {tmp_path}/b\\udcfc: {problem}"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("show", "--seed", 1, "--evaluation", 2), "--seed 1: --evaluation 2 says which level: leave one out"),
        (("show", "--group", "x"), "--group x: it is said of a file: give FILE, or use --seed or --evaluation"),
        (("show", "--index", 0), "--index 0: it is said of a file: give FILE, or use --seed or --evaluation"),
        (("show", "some.npz", "--level", "hard"), "--level hard: the level comes out of some.npz: leave it out"),
        (("show", "some.npz", "--evaluation", 0), "--evaluation 0: the level comes out of some.npz: leave it out"),
        (("show", "some.npz", "-f", "keep.yaml"), "-f keep.yaml: the level comes out of some.npz: leave it out"),
        (("export", "some.npz", "--count", 3), "--count 3: all levels come out of some.npz: leave it out"),
        (("export", "some.npz", "-f", "keep.yaml"), "-f keep.yaml: all levels come out of some.npz: leave it out"),
    ],
)
def test_options_without_use_are_refused(railctl, nothing_works, arguments, text: str):
    assert railctl(*arguments, code=2) == f"railctl: {text}\n"


def test_a_file_that_lacks_the_level_is_named(railctl, tmp_path: Path):
    path = tmp_path / "levels.npz"
    files.save(path, {"easy": [generate("easy", 1)]})
    assert f"{path}: no level of index 1 in easy, the last is 0" in railctl("show", path, "--index", 1, code=1)
    assert f"{path} has no group hard: it has easy" in railctl("show", path, "--group", "hard", code=1)


@pytest.fixture
def run_file(tmp_path: Path) -> Path:
    folder = tmp_path / "own"
    folder.mkdir()
    files.save(folder / "levels.npz", {"easy": [generate("easy", seed) for seed in range(4)]})
    (folder / "run.yaml").write_text(RUN_FILE)
    return folder / "run.yaml"


def words(output: str) -> list[str]:
    return [" ".join(line.split()) for line in output.splitlines()]


def test_what_there_is_is_listed(railctl, run_file: Path):
    listed = words(railctl("list"))
    assert listed[0] == "name rules size trains cities speeds malfunctions timetable held out"
    assert listed[1] == "easy legacy 25x25 3 2 1 no no 1000"
    assert [line.split()[0] for line in listed[1:]] == ["easy", "medium", "hard"]
    lines = words(railctl("list", "-f", run_file))
    assert lines[4] == "rush stock 20x24 4 2 50% 1, 50% 0.5 0.002 (20-50) yes 3"
    assert lines[5] == "mine stock 25x25 3 files say files say files say 2"
    rows = json.loads(railctl("list", "-f", run_file, "--json"))["levels"]
    assert rows[3] == {
        "name": "rush",
        "rules": "stock",
        "size": [20, 24],
        "trains": 4,
        "cities": 2,
        "speeds": {"1": 0.5, "0.5": 0.5},
        "malfunctions": {"rate": 0.002, "min_steps": 20, "max_steps": 50},
        "timetable": True,
        "held_out": 3,
    }
    assert (rows[4]["held_out"], rows[4]["training"]) == (2, 2)


def test_levels_of_one_s_own_are_built_verified_drawn_and_exported(railctl, run_file: Path, tmp_path: Path):
    rush = ("--level", "rush", "-f", run_file)
    railctl("build", *rush, "--seeds", "3", "--episodes", 2)
    seeds = LevelBank(tmp_path / "bank").seeds(key_of(RUSH))
    assert {evaluation_level_seed(index) for index in range(3)} < seeds
    assert f"no change in {len(seeds)} levels" in railctl("verify", "-f", run_file)
    picture = tmp_path / "level.png"
    facts = json.loads(railctl("show", *rush, "--seed", 7, "--output", picture, "--json"))
    assert facts["content_hash"] == generate_any(RUSH, 7).content_hash
    assert set(facts["speeds"]) <= {0.5, 1.0}
    assert facts["malfunctions"] == {"rate": 0.002, "min_steps": 20, "max_steps": 50}
    railctl("export", *rush, "--output", tmp_path / "out.npz")
    expected = [generate_any(RUSH, evaluation_level_seed(index)).content_hash for index in range(3)]
    assert [level.content_hash for level in files.load(tmp_path / "out.npz")["rush"]] == expected


def test_levels_out_of_files_are_drawn_and_exported(railctl, run_file: Path, tmp_path: Path):
    there = {generate("easy", seed).content_hash for seed in range(4)}
    picture = tmp_path / "level.png"
    arguments = ("--level", "mine", "-f", run_file, "--output", picture)
    shown = {
        json.loads(railctl("show", *arguments, "--json", *some))["content_hash"] for some in ((), ("--evaluation", 1))
    }
    assert len(shown) == 2
    assert shown < there
    railctl("export", "--level", "mine", "-f", run_file, "--output", tmp_path / "out.npz")
    assert {level.content_hash for level in files.load(tmp_path / "out.npz")["mine"]} < there
    assert "mine has 2 evaluation levels: there is none of index 2" in railctl(
        "show", *arguments, "--evaluation", 2, code=2
    )
    assert railctl("build", "--level", "mine", "-f", run_file, code=2).strip() == (
        "railctl: --level mine: these levels come out of files, so there is nothing to build"
    )


@pytest.mark.parametrize(
    ("levels", "problem"),
    [
        ("{rules: stock, size: [8, 8], trains: 1, cities: 2}", "levels.own.size [8, 8] has no room for two cities"),
        ("{rules: stock, size: [10, 10], trains: 1, cities: 9}", "levels.own.cities 9: no more than 4 fit on 10x10"),
        ("{rules: other, size: [20, 20], trains: 1, cities: 2}", "levels.own: say rules: legacy or rules: stock"),
        ("{files: no.pkl}", "levels.own.files no.pkl: no such file"),
    ],
)
def test_wrong_levels_are_one_line(railctl, tmp_path: Path, levels: str, problem: str):
    path = tmp_path / "run.yaml"
    path.write_text(f"levels: {{own: {levels}}}")
    output = railctl("show", "--level", "own", "-f", path, code=2)
    assert output.startswith(f"railctl: {problem}")
    assert output.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("zzz: 1", "unknown key zzz: "),
        ("level: {own: {rules: stock, size: [20, 20], trains: 1, cities: 2}}", "level: input should be a name, not {"),
        ("algorithm: nope", "unknown algorithm 'nope': "),
        ("levels: 3", "levels: input should be a valid dictionary, not 3"),
    ],
)
def test_a_file_that_is_no_run_file_is_refused_whatever_is_used_of_it(railctl, tmp_path: Path, text: str, problem: str):
    path = tmp_path / "run.yaml"
    path.write_text(text)
    assert railctl("list", "-f", path, code=2).startswith(f"railctl: {problem}")
