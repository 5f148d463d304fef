"""The command line: errors are one line on stderr with the right exit code, and leave nothing behind."""

import json
import os
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_rows import episode_row
from typer.testing import CliRunner

from railctl.common import checkpoint
from railctl.common.bus import open_bus, open_router
from railctl.common.folder import RunFolder
from railctl.common.locks import sole
from railctl.common.records.control import CommandAnswer, ProcessStatus, Status
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import RowFile
from railctl.common.wire import keys
from railctl.deploy.cli import app, main
from railctl.deploy.events import EventLog
from railctl.deploy.launch import new_run, write_cluster_file
from railctl.deploy.resolve import resolve
from railctl.deploy.supervisor import Happening

VERBS = ["up", "status", "tail", "logs", "scale", "pause", "resume", "checkpoint", "down"]
VERBS += ["evaluate", "demonstrate", "doctor", "bench"]
FAILED, WRONG_USAGE = 1, 2


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "runs"


@pytest.fixture(autouse=True)
def no_supervisor(monkeypatch):
    """Nothing is ever started here."""
    monkeypatch.setattr(
        "railctl.deploy.commands.up.start_supervisor", lambda *_: pytest.fail("a supervisor was started")
    )


def railctl(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def complaint(code, *arguments):
    """The one line that a command ends with."""
    result = railctl(*arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), repr(result.exception)
    assert result.exit_code == code
    assert result.stdout == ""
    [line] = result.stderr.splitlines()
    assert line.startswith("railctl: ")
    return line.removeprefix("railctl: ")


def output(*arguments):
    result = railctl(*arguments)
    assert (result.exit_code, result.stderr) == (0, ""), result.stderr
    return result.stdout


def completed(words, monkeypatch):
    """What a shell offers for the last word."""
    monkeypatch.setenv("_RAILCTL_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split(" ")) - 1))
    return CliRunner().invoke(app, [], prog_name="railctl").stdout.split()


def test_it_says_its_version():
    assert output("--version") == f"railctl {version('railctl')}\n"


def test_a_shell_completes_verbs_options_and_the_names_of_runs(root, monkeypatch):
    make("first-run")
    assert completed("railctl st", monkeypatch) == ["status", "study"]
    assert completed("railctl up --epi", monkeypatch) == ["--episodes"]
    assert completed("railctl levels sh", monkeypatch) == ["show"]
    for verb in ("status", "tail", "down", "pause", "logs", "scale"):
        assert completed(f"railctl {verb} fi", monkeypatch) == ["first-run"]


def make(name="one", **given):
    return new_run(name, resolve({"episodes": 10, "cluster": {"cores": 1}} | given))


def write_episodes(folder, count):
    file = RowFile(folder.episodes_file, EpisodeRow)
    for number in range(count):
        file.append(episode_row(number))
    file.close()


# Help


def test_help_names_every_verb():
    text = output("--help")
    for verb in VERBS:
        assert verb in text


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(verb):
    assert "Usage" in output(verb, "--help")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["up", "--name", ""], "--name: what follows is empty"),
        (["up", "--name="], "--name: what follows is empty"),
        (["up", "--actors", ""], "--actors: what follows is empty"),
        (["report", "--output", ""], "--output: what follows is empty"),
        (["levels", "export", "--output", ""], "--output: what follows is empty"),
        (["status", ""], "status: what follows is empty"),
        ([""], "railctl: what follows is empty"),
        (["status", "one\udcff"], "'one\\udcff' is not text in UTF-8"),
        (["up", "-f", "\udc80.yaml"], "'\\udc80.yaml' is not text in UTF-8"),
    ],
)
def test_no_word_is_empty_and_all_are_text(root, arguments, text):
    result = railctl(*arguments)
    assert (result.exit_code, result.stdout) == (WRONG_USAGE, "")
    assert text in result.stderr
    assert not root.exists()


LONG = "a" * 5000


@pytest.mark.parametrize(
    "arguments",
    [
        ["status", LONG],
        ["tail", LONG],
        ["logs", LONG],
        ["scale", LONG, "easy=1"],
        ["down", LONG],
        ["up", "--name", LONG],
        ["up", "-f", LONG],
        ["up", "--level", LONG],
        ["up", "--algorithm", LONG],
        ["up", "--actors", f"{LONG}=1"],
        ["up", "--set", f"start_from={LONG}"],
        ["up", "--set", f"{LONG}=1"],
        ["up", "--set", LONG],
        ["evaluate", LONG],
        ["evaluate", "random", "--levels", LONG],
        ["evaluate", "random", "--level", LONG],
        ["demonstrate", "planner", "--out", LONG],
        ["report", LONG],
        ["report", "--curves", LONG],
        ["study", "plan", LONG],
        ["study", "plan", f"{LONG}.yaml"],
        ["bench", LONG],
    ],
    ids=lambda arguments: " ".join(arguments)[:30],
)
def test_what_is_too_long_to_be_a_name_is_said_shortly(root, arguments):
    assert len(complaint(WRONG_USAGE, *arguments)) < 400


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["evaluate", "random", "--draws", 2**70], f"draws: input should be less than or equal to {2**53 - 1}, not "),
        (["evaluate", "random", "--episodes", 2**70], "episodes: input should be less than or equal to 1000000, not "),
        (["evaluate", "random", "--seed", 2**70], f"seed: input should be less than or equal to {2**53 - 1}, not "),
        (["evaluate", "planner", "--orders", 2**70], f"--orders {2**70}: use 1 to 100000"),
        (["up", "--episodes", 2**70], f"episodes: input should be less than or equal to 10000000, not {2**70}"),
        (["up", "--seed", 2**70], f"seed: input should be less than 2147483648, not {2**70}"),
        (["up", "--lag", 2**70], f"lag: '{2**70}' is no lag: give a whole number from 0 to 1024, or free"),
        (["up", "--lag", "1" * 5000], f"lag: '{'1' * 76}... is no lag: give a whole number from 0 to 1024, or free"),
        (["up", "--cores", 2**70], f"cluster.cores: input should be less than or equal to {2**53 - 1}, not {2**70}"),
        (["levels", "build", "--seeds", "5-1"], "--seeds '5-1': use a number below 2**31, or two as 1-10"),
        (["levels", "build", "--seeds", "-1"], "--seeds '-1': use a number below 2**31, or two as 1-10"),
        (
            ["levels", "build", "--seeds", "1" * 5000],
            f"--seeds '{'1' * 76}...: use a number below 2**31, or two as 1-10",
        ),
        (["levels", "build", "--seeds", "\u0661"], "--seeds '\u0661': use a number below 2**31, or two as 1-10"),
        (["levels", "build", "--seeds", "0-999999"], "--seeds 0-999999 and --episodes 1500: 10000000 training levels"),
        (["levels", "build", "--evaluation", 1001], "evaluation: input should be less than or equal to 1000, not 1001"),
        (["levels", "build", "--processes", 2**70], "processes: input should be less than or equal to 1024, not "),
        (["levels", "show", "--seed", 2**70], f"seed: input should be less than 4294967296, not {2**70}"),
        (["levels", "export", "--count", 2**70], "count: input should be less than or equal to 500000, not "),
    ],
)
def test_numbers_that_are_too_large_for_anything_are_refused(root, arguments, text):
    assert complaint(WRONG_USAGE, *arguments).startswith(text)


def test_whatever_is_in_a_name_the_complaint_is_one_line(root):
    assert complaint(WRONG_USAGE, "status", "a\nb\x1b[31m").startswith("no run named 'a\\nb\\x1b[31m'")
    assert complaint(WRONG_USAGE, "evaluate", "a\nb.safetensors").startswith("a\\nb.safetensors: no such file")


def test_a_run_that_has_lost_its_configuration_is_told_of_it(root):
    folder = make()
    folder.config_file.unlink()
    text = f"{folder.path} is there, without its config.yaml: restore that, or give another name"
    assert complaint(WRONG_USAGE, "up", "--name", "one") == text
    assert complaint(WRONG_USAGE, "status", "one") == text


@pytest.mark.parametrize(
    "arguments", [["fly"], ["up", "--fly"], ["up", "--episodes", "many"], ["scale"], ["logs", "-n", "-1"]]
)
def test_wrong_usage_has_its_own_exit_code_and_no_traceback(root, arguments):
    result = railctl(*arguments)
    assert result.exit_code == WRONG_USAGE
    assert "Traceback" not in result.stderr
    assert not root.exists()


# up: what is wrong is said before anything is made


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--algorithm", "dddq"], "unknown algorithm 'dddq': did you mean dddqn? known are dddqn"),
        (["--level", "esy"], "unknown level 'esy': did you mean easy? known are easy, hard, medium"),
        (["--set", "dqn.batchsize=5"], "unknown key dqn.batchsize: did you mean batch_size? known are batch_size, "),
        (["--set", "xyzzy=red"], "unknown key xyzzy: known are algorithm, cluster, "),
        (["--set", "dqn.batch_size"], "--set 'dqn.batch_size' is not key=value: write for example "),
        (["--set", "seed=[1"], "--set seed: '[1' is not a YAML value"),
        (["--actors", "easy"], "actors 'easy' is not level=count: write for example easy=2,hard=1"),
        (["--actors", "esy=1"], "no actors for level easy: add --actors easy=1"),
        (["--actors", "hard=1"], "no actors for level easy: add --actors easy=1"),
        (["--actors", "easy=1,hard=1"], "actors for level hard, which this run does not have: it has easy"),
        (["--level", "easy", "--actors", "hard=0,rush=1"], "no actors for level easy: add --actors easy=1"),
        (["--actors", "easy=257"], "actors 'easy=257': at most 256 of a level"),
        (["--episodes", "0"], "episodes: input should be greater than or equal to 1, not 0"),
        (["--seed", "-1"], "seed: input should be greater than or equal to 0, not -1"),
        (["--cores", "0"], "cluster.cores: input should be greater than or equal to 1, not 0"),
        (["--engine", "stone"], "engine: input should be 'compiled' or 'flatland', not 'stone'"),
        (["--level", "easy", "--set", "mix={easy: 1}"], "level and mix are both given: leave one out"),
        (["--name", "a/b"], "--name 'a/b': use letters, digits, '.', '_', '+' and '-', at most 100"),
        (["--file", "none.yaml"], "none.yaml cannot be read: No such file or directory: give an existing YAML"),
    ],
)
def test_what_is_wrong_with_a_new_run_is_one_line_and_nothing_is_made(root, tmp_path, arguments, text):
    assert complaint(WRONG_USAGE, "up", *arguments).startswith(text)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("a: [1\nb: {", "run.yaml is not YAML: "),
        ("- easy", "run.yaml holds no keys: write for example 'algorithm: dddqn'"),
        ("episods: 5", "unknown key episods: did you mean episodes?"),
        ("mix: {easy: 0.5, hard: 0.25}", "the shares of mix add up to 0.75: make it 1"),
        ("level: rush", "unknown level 'rush': known are easy, hard, medium"),
        ("level: rush\nlevels: {rush: {rules: stock}}", "levels.rush.size is missing: give it a value"),
        (
            "level: rush\nlevels: {rush: {size: [9, 9]}}",
            "levels.rush: say rules: legacy or rules: stock, or give files",
        ),
        ("levels: {easy: {rules: stock}}", "levels.easy: these levels ship with the project, give yours another name"),
        (
            "levels: {rush: {rules: stock, size: [30, 30], trains: 3, cities: 2}}",
            "levels: nothing says that rush is played: add mix: {rush: 1}, or choose level rush",
        ),
        ("observation: gloval", "observation.kind: unknown 'gloval': known are "),
        ("reward: {kind: study, bonus: 1}", "unknown key reward.bonus: "),
        ("decisions: often", "decisions: input should be 'cells', 'legacy' or 'always', not 'often'"),
        ("algorithm: ppo\nreplay: prioritized", "replay: rule ppo has no use for it, leave it out"),
        ("dqn: {learning_rate: {x: 1}}", "dqn.learning_rate: input should be a valid number, not {'x': 1}"),
        ("cluster: 5", "cluster: cannot be both 5 and {'cores': 1}: give one of them"),
    ],
)
def test_what_is_wrong_with_a_run_file_is_one_line(root, content, text):
    Path("run.yaml").write_text(content)
    assert complaint(WRONG_USAGE, "up", "-f", "run.yaml", "--cores", "1").startswith(text)
    assert not root.exists()


@pytest.mark.parametrize("setting", ["cluster=5", "mix=", "seed=2024-13-45"])
def test_settings_of_another_kind_are_one_line_too(root, setting):
    complaint(WRONG_USAGE, "up", "--set", setting)


def test_what_this_machine_cannot_do_is_a_failure(root):
    cores = len(os.sched_getaffinity(0))
    assert complaint(FAILED, "up", "--cores", cores + 1) == (
        f"cluster.cores is {cores + 1} and this machine offers {cores}: use --cores {cores}"
    )
    assert not root.exists()


def test_runs_that_cannot_be_written_are_a_failure(root, monkeypatch):
    root.write_text("a file")
    assert complaint(FAILED, "up", "--name", "one", "--cores", "1").startswith(f"cannot create {root}/one: ")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--episodes", "20"], "run one exists with episodes 10, not 20: leave the option out "),
        (["--level", "hard"], "run one exists with level easy, not level hard"),
        (["--cores", "0"], "cluster.cores: input should be greater than or equal to 1, not 0"),
    ],
)
def test_an_existing_run_is_not_made_another_one(root, arguments, text):
    folder = make()
    before = folder.config_file.read_bytes()
    assert complaint(WRONG_USAGE, "up", "--name", "one", *arguments).startswith(text)
    assert folder.config_file.read_bytes() == before


def test_a_damaged_snapshot_is_found_before_anything_starts(root):
    folder = make()
    folder.snapshots.mkdir()
    path = folder.snapshots / "00000005.safetensors"
    checkpoint.save(path, {"w": np.ones(3, np.float32)}, {}, "snapshot")
    path.write_bytes(path.read_bytes()[:-1] + b"\xff")
    before = folder.config_file.read_bytes()
    assert complaint(FAILED, "up", "--name", "one", "--actors", "easy=2").startswith(f"{path}: damaged")
    assert folder.config_file.read_bytes() == before
    assert not folder.cluster_file.exists()


def test_a_damaged_configuration_is_named(root):
    folder = make()
    folder.config_file.write_text("episodes: 5")
    assert complaint(WRONG_USAGE, "up", "--name", "one") == (f"{folder.config_file}: rule is missing: give it a value")


@pytest.fixture
def started(monkeypatch):
    """The runs that `up` starts, without starting them."""
    runs = []
    monkeypatch.setattr(
        "railctl.deploy.commands.up.start_supervisor", lambda folder, config, _actors: runs.append((folder, config))
    )
    return runs


def test_up_makes_a_run_of_preset_file_options_and_settings(root, started):
    Path("run.yaml").write_text("episodes: 7\nseed: 5\ndiscount: 0.5\ndqn: {batch_size: 9}\n")
    text = output(
        *("up", "-f", "run.yaml", "--name", "one", "--detach", "--level", "hard", "--seed", "6", "--cores", "1"),
        *("--set", "discount=0.75", "--set", "network.hidden=[8]", "--actors", "hard=2"),
    )
    assert text.splitlines() == [f"run one in {root}/one", "follow it with: railctl tail one"]
    [(folder, config)] = started
    assert folder == RunFolder(root / "one")
    assert folder.config() == config
    assert (config.episodes, config.seed, config.learning.discount, config.learning.dqn.batch_size) == (7, 6, 0.75, 9)
    assert (config.mix, config.cluster.actors, config.learning.network.hidden) == ({"hard": 1.0}, {"hard": 2}, (8,))
    assert yaml.safe_load(folder.config_file.read_text())["dqn"]["learn_every_steps"] == 30  # all is resolved


def test_up_makes_a_run_of_a_world_of_ones_own(root, started):
    Path("run.yaml").write_text(
        "levels:\n"
        "  rush-hour: {rules: stock, size: [40, 30], trains: 20, cities: 4, speeds: {1: 0.5, 0.5: 0.5}, held_out: 2,\n"
        "              malfunctions: {rate: 0.002, min_steps: 20, max_steps: 50}}\n"
        "mix: {easy: 0.5, rush-hour: 0.5}\nobservation: {kind: tree, depth: 1}\ndecisions: always\nreward: delay\n"
    )
    first = railctl(
        "up", "-f", "run.yaml", "--name", "one", "--detach", "--actors", "rush-hour=2,easy=1", "--cores", "1"
    )
    assert "rush-hour: 2 of 2" in first.stderr  # what is held out is drawn once, with progress
    [(folder, config)] = started
    assert folder.config() == config
    assert config.world.bounds == (40, 30, 20)
    assert config.world.levels["rush-hour"].speeds == {1.0: 0.5, 0.5: 0.5}
    assert (config.world.decisions, config.world.reward.kind, config.world.n_features) == ("always", "delay", 60)
    assert config.cluster.actors == {"easy": 1, "rush-hour": 2}
    output("up", "-f", "run.yaml", "--name", "one", "--detach")  # goes on
    assert started[1][1].science == config.science


def test_up_gives_a_run_a_name(root, started):
    output("up", "--detach", "--cores", "1")
    [(folder, _)] = started
    assert folder.path.name.startswith("dddqn-easy-seed1-")


def test_up_goes_on_with_a_run_and_may_change_its_cluster(root, started):
    make(seed=3)
    output("up", "--name", "one", "--detach", "--actors", "any=3")
    [(folder, config)] = started
    assert (config.seed, config.cluster.actors) == (3, {"any": 3})
    assert folder.config() == config


@pytest.mark.parametrize(
    ("outcome", "code", "last"),
    [
        ("finished", 0, None),
        ("stopped", 0, "stopped after 3 episodes; railctl up --name one goes on"),
        ("failed", FAILED, "railctl: no disk"),
    ],
)
def test_up_tells_how_a_run_ended(root, started, monkeypatch, outcome, code, last):
    """As its foreground does when the run ends."""
    folder = make()
    write_episodes(folder, 3)

    def end(folder):
        folder.outcome_file.write_text(json.dumps({"outcome": outcome, "reason": "no disk"}))

    monkeypatch.setattr("railctl.deploy.commands.up.follow_to_end", end)
    result = railctl("up", "--name", "one")
    assert result.exit_code == code
    lines = (result.stdout + result.stderr).splitlines()
    assert any("Summary" in line for line in lines)
    assert f"curve    {folder.curve_file}" in lines
    assert lines[-1] == last or (last is None and lines[-1] == f"run      {folder.path}")
    assert len(started) == 1


def test_up_on_a_finished_run_only_tells_how_it_ended(root):
    folder = make()
    write_episodes(folder, 3)
    folder.outcome_file.write_text(json.dumps({"outcome": "finished", "reason": ""}))
    lines = output("up", "--name", "one").splitlines()
    assert lines[0] == "run one is finished"
    assert lines[-1] == f"run      {folder.path}"


def test_a_full_disk_is_a_line(root, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("railctl.deploy.commands.up.prepare", full)
    assert complaint(FAILED, "up") == "No space left on device: make room on the disk, then run it again"


# Runs that are not there


@pytest.mark.parametrize(
    "arguments",
    [["status"], ["tail"], ["logs"], ["down"], ["pause"], ["resume"], ["checkpoint"], ["scale", "easy=1"]],
    ids=lambda arguments: arguments[0],
)
def test_an_unknown_run_is_wrong_usage(root, arguments):
    verb, *rest = arguments
    assert complaint(WRONG_USAGE, verb, "nine", *rest).startswith("no run named 'nine': there are no runs in ")
    make("nine-1")
    assert complaint(WRONG_USAGE, verb, "nine", *rest) == "no run named 'nine': did you mean nine-1? known are nine-1"


@pytest.mark.parametrize(
    "arguments", [["pause"], ["resume"], ["checkpoint"], ["scale", "easy=1"]], ids=lambda arguments: arguments[0]
)
def test_a_run_that_is_not_running_is_a_failure(root, arguments):
    folder = make()
    verb, *rest = arguments
    assert complaint(FAILED, verb, "one", *rest) == "run one has no cluster: start one with railctl up"
    write_cluster_file(folder, folder.config())
    assert complaint(FAILED, verb, "one", *rest) == ("run one is not running: railctl up --name one resumes it")


def test_a_run_that_is_not_running_is_down(root):
    make()
    assert output("down", "one") == "run one is not running\n"
    assert json.loads(output("down", "one", "--json")) == {"done": True, "text": "not running"}


def test_the_status_of_a_run_that_is_not_running(root):
    folder = make()
    write_episodes(folder, 3)
    folder.outcome_file.write_text(json.dumps({"outcome": "failed", "reason": "no disk [Errno 28]"}))
    text = output("status")
    assert text.startswith("one: failed  3/10 episodes  return(100) -0.500")
    assert "! no disk [Errno 28]" in text
    found = json.loads(output("status", "--json"))
    assert (found["run"], found["state"], found["progress"]["done"]) == ("one", "failed", 3)


def test_the_rows_of_a_run_that_is_not_running(root):
    folder = make()
    write_episodes(folder, 3)
    assert [line.split()[:2] for line in output("tail", "one").splitlines()] == [
        ["episode", "0"],
        ["episode", "1"],
        ["episode", "2"],
    ]
    rows = [json.loads(line) for line in output("tail", "one", "--json").splitlines()]
    assert [EpisodeRow.model_validate(row) for row in rows] == [episode_row(number) for number in range(3)]


@pytest.mark.parametrize("verb", ["status", "tail"])
def test_damaged_rows_are_named(root, verb):
    folder = make()
    folder.episodes_file.write_text("nonsense\n")
    assert complaint(FAILED, verb, "one").startswith(f"{folder.episodes_file} line 1 is not a valid row")


def test_what_may_not_be_read_is_named(root, monkeypatch):
    folder = make()
    write_episodes(folder, 1)

    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("railctl.common.rows.open_at_once", refuse)
    assert complaint(FAILED, "tail", "one") == (
        f"{folder.episodes_file}: Permission denied: use a folder that you may read and write"
    )


# Logs


@pytest.fixture
def logged(root):
    folder = make()
    (folder.logs / "learner.log").write_text("".join(f"line {number} [red]\n" for number in range(30)))
    (folder.logs / "router.log").write_text("routes\n")
    return folder


def test_logs_are_the_last_lines_of_each_process(logged):
    lines = output("logs", "one").splitlines()
    assert lines[0].split() == ["learner", "line", "10", "[red]"]
    assert lines[19].split() == ["learner", "line", "29", "[red]"]
    assert lines[20].split() == ["router", "routes"]
    assert len(output("logs", "one", "learner", "-n", "3").splitlines()) == 3
    assert json.loads(output("logs", "one", "--json", "-n", "1")) == {
        "learner": ["line 29 [red]"],
        "router": ["routes"],
    }


def test_wrong_questions_about_logs(logged):
    assert complaint(WRONG_USAGE, "logs", "one", "lerner") == (
        "run one has no process 'lerner': did you mean learner? known are learner, router"
    )
    assert complaint(WRONG_USAGE, "logs", "one", "--json", "--follow").startswith("--follow and --json: ")


# A run that is running


@pytest.fixture
def cluster(root):
    """A run whose router, learner and supervisor are this process."""
    folder = make()
    write_cluster_file(folder, folder.config())
    endpoint, namespace = folder.endpoint_and_namespace()
    said = []
    status = Status(
        run="one",
        path=str(folder.path),
        state="running",
        algorithm="dddqn",
        episodes=10,
        supervisor_pid=1,
        progress=None,
        time_left_s=None,
        problems=["something [is] wrong"],
        processes=[
            ProcessStatus(
                process="learner",
                role="learner",
                serves=None,
                pid=77,
                state="training",
                restarts=2,
                last_heartbeat_unix_s=None,
            )
        ],
    )

    def obey(question):
        said.append(question.request)
        wrong = getattr(question.request, "actors", {}).get("hard")
        question.answer(CommandAnswer(done=not wrong, text="no such level" if wrong else "done so"))

    with ExitStack() as stack:
        stack.enter_context(open_router(endpoint))
        stack.enter_context(sole(folder, "learner"))
        stack.enter_context(sole(folder, "supervisor"))
        bus = stack.enter_context(open_bus(endpoint, namespace, 10.0))
        bus.serve(keys.STATUS, lambda question: question.answer(status))
        bus.serve(keys.SCALE, obey)
        bus.serve(keys.COMMAND_LEARNER, obey)
        yield said


def test_a_run_of_another_machine_is_seen_and_not_steered(root):
    folder = make()
    write_cluster_file(folder, folder.config())
    kept = folder.cluster_file.read_bytes()
    with ExitStack() as stack:
        with pytest.MonkeyPatch.context() as there:
            there.setattr("railctl.common.locks._machine", lambda: "another")
            there.setattr("socket.gethostname", lambda: "node7")
            stack.enter_context(sole(folder, "supervisor"))
        for arguments in (["up", "--name", "one"], ["down", "one"], ["down", "--force", "one"]):
            assert complaint(FAILED, *arguments) == "run one runs on node7: ask there, or stop it there first"
        for arguments in (["pause", "one"], ["scale", "one", "easy=2"], ["checkpoint", "one"]):
            assert complaint(FAILED, *arguments) == "run one runs on node7: ask there"
        text = output("status", "one")
        assert text.startswith("one: running")
        assert text.endswith("! run one runs on node7: ask there\n")
        assert json.loads(output("list", "--json"))["runs"][0]["state"] == "running"
        assert folder.cluster_file.read_bytes() == kept


def test_the_status_of_a_running_run(cluster):
    text = output("status", "one")
    assert text.startswith("one: running ...")
    assert "77" in text
    assert "! something [is] wrong" in text
    document = json.loads(output("status", "--json"))
    assert document.pop("events") == []
    assert Status.model_validate_json(json.dumps(document)).supervisor_pid == 1


def test_the_status_ends_with_the_last_events(cluster, root):
    log = EventLog(RunFolder(root / "one"))
    for number in range(7):
        log.write(Happening("died", "learner", f"learner died [{number}]"))
    log.close()
    lines = output("status", "one").splitlines()[-5:]
    assert [line.partition("Z  ")[2] for line in lines] == [f"learner died [{number}]" for number in range(2, 7)]
    told = json.loads(output("status", "one", "--json"))["events"]
    assert [event["text"] for event in told] == [f"learner died [{number}]" for number in range(2, 7)]
    assert lines[-1].startswith(f"{told[-1]['time'][:10]} {told[-1]['time'][11:19]}Z")


@pytest.mark.parametrize("verb", ["pause", "resume", "checkpoint"])
def test_a_command_to_the_learner(cluster, verb):
    assert output(verb, "one") == "done so\n"
    assert json.loads(output(verb, "--json")) == {"done": True, "text": "done so"}
    assert [request.verb for request in cluster] == [verb, verb]


def test_a_checkpoint_is_named_as_the_user_names_its_run(cluster, root, monkeypatch):
    """The learner was started with an absolute path."""
    answer = CommandAnswer(done=True, text=f"wrote {root.resolve()}/one/file")
    monkeypatch.setattr("railctl.common.bus.Bus.ask", lambda *_: answer)
    monkeypatch.setenv("RAILCTL_RUNS", "runs")
    assert output("checkpoint", "one") == "wrote runs/one/file\n"
    monkeypatch.chdir(root / "one")
    assert json.loads(output("checkpoint", ".", "--json"))["text"] == "wrote ./file"


def test_scaling(cluster):
    assert output("scale", "one", "easy=3", "any=1") == "done so\n"
    assert cluster[0].actors == {"easy": 3, "any": 1}
    assert complaint(FAILED, "scale", "one", "hard=1") == "no such level"
    assert complaint(WRONG_USAGE, "scale", "one", "e sy=1").startswith("actors 'e sy=1': ")
    assert len(cluster) == 2


def test_scaling_beyond_the_limit_is_wrong_usage(cluster):
    complaint(WRONG_USAGE, "scale", "one", "easy=257")


def test_up_on_a_running_run_scales_it(cluster):
    lines = output("up", "--name", "one", "--detach", "--actors", "easy=2").splitlines()
    assert lines[:2] == ["run one is running already", "done so"]
    assert cluster[0].actors == {"easy": 2}


def test_up_on_a_running_run_opens_no_door(cluster, root):
    text = complaint(FAILED, "up", "--name", "one", "--detach", "--listen", "tls/127.0.0.1:1", "--keys", "keys")
    assert text == "run one is running, and its router listens elsewhere: railctl down one first"
    assert "listen: null" in (root / "one" / "config.yaml").read_text()


def test_a_tail_of_a_running_run_has_history_and_ends_with_it(cluster, root, monkeypatch):
    write_episodes(RunFolder(root / "one"), 2)
    monkeypatch.setattr("railctl.deploy.commands.tail.living", lambda _folder: {})
    assert len(output("tail", "one").splitlines()) == 2


def test_other_systems_are_refused_by_name(monkeypatch, capsys):
    monkeypatch.setattr("platform.system", lambda: "Darwin")
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == WRONG_USAGE
    assert capsys.readouterr().err.startswith("railctl: Darwin is not supported: use Linux")
