"""railctl evaluate, from the command line to the table."""

import json
from functools import partial
from pathlib import Path

import command_line
import pytest

from railctl.common import checkpoint
from railctl.common.levels import files
from railctl.common.levels.supply import LevelSupply
from railctl.common.requests import LevelChoice, ScoreRequest
from railctl.common.rules.settings import NetworkConfig
from railctl.deploy.commands import evaluate as command
from railctl.deploy.launch import new_run
from railctl.deploy.resolve import resolve


@pytest.fixture
def run(tmp_path, monkeypatch, write_checkpoint):
    """A run with two checkpoints, and one that a user keeps beside them."""
    monkeypatch.setenv("RAILCTL_RUNS", "runs")
    monkeypatch.chdir(tmp_path)
    folder = new_run("one", resolve({"episodes": 10, "cluster": {"cores": 1}}))
    folder.checkpoints.mkdir(exist_ok=True)
    for name in ("00000050", "00000100", "best"):
        write_checkpoint(folder.checkpoints / f"{name}.safetensors", NetworkConfig(kind="actor-critic"))
    files.save(Path("levels.npz"), {"easy": [LevelSupply().evaluation("easy", index) for index in range(3)]})
    return folder


railctl = partial(command_line.railctl, "evaluate")


def complaint(code, *arguments):
    return command_line.complaint(code, "evaluate", *arguments)


def test_a_run_is_scored_by_its_newest_checkpoint(run):
    result = railctl("one", "--levels", "levels.npz", "--sample", "--draws", 3, "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["checkpoint"] == "runs/one/checkpoints/00000100.safetensors"
    [row] = document["rows"]
    assert (document["mode"], document["draws"], row["level"], len(row["returns"])) == ("sample", 3, "easy", 3)
    assert "easy: 3 of 3" in result.stderr


def test_a_table_for_people(run, monkeypatch):
    asked = []
    row = {"level": "easy", "levels": 2, "mean": -0.3004, "low": -0.5, "high": None, "std": 0.25, "median": -0.2}
    row |= {"arrived_share": 0.8333, "all_arrived_share": 0.5, "mean_steps": 120.25, "score": None, "returns": []}
    document = {"checkpoint": "given", "algorithm": "sil", "episode": 7, "mode": "greedy", "rows": [row]}
    monkeypatch.setattr(command, "run_task", lambda *arguments: asked.append(arguments) or document)
    path = str(run.checkpoints / "best.safetensors")
    result = railctl(path, "--level", "easy", "--level", "easy", "--episodes", 2)
    assert [scorer for scorer, _ in asked] == [command.SCORER]
    bank = Path("runs/.levels")
    assert request(asked) == ScoreRequest(checkpoint=path, levels=LevelChoice(names=("easy",), episodes=2, bank=bank))
    first, *_, figures, caption = result.stdout.splitlines()
    assert first == "given: sil after 7 episodes, greedy"
    assert figures.split() == ["easy", "2", "-0.300", "-0.500", "-", "-0.200", "0.250", "83.3%", "50.0%", "120.2"]
    assert caption == "return: normalised, mean over levels; low, high: its 95% interval (bootstrap)"
    result = railctl(path, "--seed", 4)
    assert request(asked).levels == LevelChoice(seed=4, bank=bank)
    assert "training may know rails of the levels of seed 4" in result.stdout.splitlines()[-1]
    railctl(path, "--greedy")
    assert (request(asked).mode, request(asked).draws) == ("greedy", None)
    railctl(path, "--sample", "--draws", 0)
    assert (request(asked).mode, request(asked).draws) == ("sample", 0)
    Path("run.yaml").write_text("levels: {mine: {rules: stock, size: [30, 30], trains: 2, cities: 2}}")
    railctl(path, "--level", "mine", "-f", "run.yaml")
    assert list(request(asked).levels.own) == ["mine"]


def request(asked):
    """The newest request."""
    return ScoreRequest.model_validate_json(asked[-1][1])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["two"], "no file two, and no run named 'two': known are one"),
        (["no.safetensors"], "no.safetensors: no such file: the checkpoints of a run lie in its folder checkpoints"),
        (["/dev/null"], "/dev/null is no regular file: give the file of a checkpoint, or a run"),
        (["one", "--level", "esy"], "unknown level 'esy': did you mean easy? known are easy, hard, medium"),
        (["one", "--episodes", "0"], "--episodes 0: use a number above 0"),
        (["one", "--seed", "-1"], "--seed -1: use 0 or a number above"),
        (["one", "--levels", "no.npz"], "--levels no.npz: no such file"),
        (
            ["one", "--levels", "levels.npz", "--episodes", "2"],
            "--levels and --episodes: all levels of levels.npz are played, leave --episodes out",
        ),
        (
            ["one", "--levels", "levels.npz", "--seed", "2"],
            "--levels and --seed: given levels are not drawn, leave --seed out (--draws is of sampling)",
        ),
        (
            ["one", "--levels", "levels.npz", "-f", "own.yaml"],
            "--levels and -f: the levels come out of levels.npz, leave -f out",
        ),
        (["one", "--draws", "-1"], "--draws -1: use 0 or a number above"),
        (
            ["one", "--greedy", "--draws", "1"],
            "--draws 1 and --greedy: greedy play draws nothing, leave one of them out",
        ),
    ],
)
def test_wrong_usage_is_one_line(run, arguments, text):
    assert complaint(2, *arguments) == f"railctl: {text}"


def test_a_run_without_checkpoints_says_how_to_get_one(run):
    for path in run.checkpoints.glob("0*"):
        path.unlink()
    assert complaint(1, "one") == "railctl: run one has no checkpoint yet: railctl checkpoint one writes one"


def test_a_snapshot_is_no_checkpoint(run):
    path = run.snapshots / "00000100.safetensors"
    run.snapshots.mkdir(exist_ok=True)
    checkpoint.save(path, {}, {}, "snapshot")
    assert complaint(1, path) == (
        f"railctl: {path}: is a 'snapshot', not a checkpoint: a run has checkpoints/ and snapshots/"
    )
