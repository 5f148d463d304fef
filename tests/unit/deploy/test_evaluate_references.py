"""railctl evaluate with the name of a reference policy."""

import json
from functools import partial
from pathlib import Path

import command_line
import pytest

from railctl.common.levels import files
from railctl.common.levels.supply import LevelSupply
from railctl.common.requests import LevelChoice, ReferenceRequest
from railctl.deploy.commands import evaluate as command
from railctl.deploy.launch import new_run
from railctl.deploy.resolve import resolve


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a file of levels, and a run that is named as a policy is."""
    monkeypatch.setenv("RAILCTL_RUNS", "runs")
    monkeypatch.chdir(tmp_path)
    new_run("planner", resolve({"episodes": 10, "cluster": {"cores": 1}}))
    files.save(Path("levels.npz"), {"easy": [LevelSupply().evaluation("easy", index) for index in range(3)]})


railctl = partial(command_line.railctl, "evaluate")


def test_a_policy_is_scored_by_its_name(here):
    result = railctl("planner", "--levels", "levels.npz", "--orders", 3, "--draws", 1, "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    [row] = document["rows"]
    assert (document["policy"], document["orders"], document["draws"]) == ("planner", 3, 1)
    assert (row["level"], len(row["returns"]), row["all_arrived_share"]) == ("easy", 3, 1)
    assert "easy: 3 of 3" in result.stderr
    table = railctl("shortest-path", "--levels", "levels.npz")
    assert table.stdout.splitlines()[0] == "shortest-path"
    assert len(table.stdout.splitlines()) == 5


def test_the_name_of_a_policy_wins_and_a_path_is_a_run(here, monkeypatch):
    asked = []
    document = {"policy": "planner", "orders": 50, "rows": []}
    monkeypatch.setattr(command, "run_task", lambda *arguments: asked.append(arguments) or document)
    railctl("planner", "--seed", 4)
    [(scorer, request)] = asked
    assert scorer == "railctl.services.evaluator.references"
    levels = LevelChoice(seed=4, bank=Path("runs/.levels"))
    assert ReferenceRequest.model_validate_json(request) == ReferenceRequest(policy="planner", levels=levels)
    assert railctl("runs/planner").stderr.startswith("railctl: run planner has no checkpoint yet")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (
            ["random", "--sample"],
            "--sample: random is no network whose actions could be drawn, or the best: leave it out",
        ),
        (["alone", "--draws", "1"], "--draws 1: alone draws nothing, leave it out"),
        (
            ["alone", "--orders", "3"],
            "--orders: only planners try orders of trains, alone does not: leave it out",
        ),
        (["runs/planner", "--orders", "3"], "--orders: only planners try orders of trains: leave it out"),
        (["planner", "--orders", "0"], "--orders 0: use 1 to 100000"),
        (
            ["shortest-path", "--levels", "levels.npz", "--seed", "2"],
            "--levels and --seed: given levels are not drawn, leave --seed out (--draws is of sampling)",
        ),
        (["planner", "--seed", "-1"], "--seed -1: use 0 or a number above"),
        (["planner", "--level", "esy"], "unknown level 'esy': did you mean easy? known are easy, hard, medium"),
        (
            ["randm"],
            "no file randm, and no run named 'randm': known are planner; did you mean the policy random?",
        ),
    ],
)
def test_wrong_usage_is_one_line(here, arguments, text):
    result = railctl(*arguments)
    assert (result.exit_code, result.stdout, result.stderr.splitlines()) == (2, "", [f"railctl: {text}"])
