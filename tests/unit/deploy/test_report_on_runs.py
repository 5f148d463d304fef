"""railctl report, from the command line to the page."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from railctl.deploy.cli import app
from railctl.deploy.commands import report as command

sys.path.append(str(Path(__file__).parents[1] / "analysis" / "report"))
import made_study


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Two runs, and one that has not begun."""
    monkeypatch.setenv("RAILCTL_RUNS", "runs")
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        made_study.make_run(Path("runs", name), np.linspace(-1, -0.5, 9), algorithm="ppo", level="hard", scored=-0.5)
    return made_study.make_run(Path("runs", "new"), [], episodes=5)


def railctl(*arguments):
    result = CliRunner().invoke(app, ["report", *map(str, arguments)])
    assert result.exception is None or isinstance(result.exception, SystemExit), repr(result.exception)
    return result


def test_a_run_has_its_report_in_its_folder(runs):
    result = railctl("one", "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document == {"report": "runs/one/report/report.html", "figures": 4, "tables": 6, "runs": {"done": 1}}
    assert Path(document["report"]).read_text().startswith("<!DOCTYPE html>")
    assert "drawing: 4 of 4" in result.stderr


def test_where_reports_go_and_what_is_said(runs, monkeypatch):
    asked = []
    answer = {"report": "there/report.html", "figures": 4, "tables": 6, "runs": {"done": 1, "unfinished": 1}}
    monkeypatch.setattr(command, "run_task", lambda *arguments: asked.append(arguments) or answer)
    result = railctl("one", "runs/new")
    assert asked.pop() == (command.REPORTER, "--run", "runs/one", "--run", "runs/new", "--output", "report")
    assert result.stdout.splitlines() == [
        "4 figures and 6 tables on runs: 1 done, 1 unfinished",
        "report   there/report.html",
    ]
    railctl()
    assert asked.pop() == (command.REPORTER, "--run", "runs/new", "--output", "runs/new/report")
    railctl("one", "--output", "there")
    assert asked.pop() == (command.REPORTER, "--run", "runs/one", "--output", "there")


@pytest.mark.usefixtures("tasks_here")
@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["three"], 2, "no run named 'three': known are new, one, two"),
        (
            ["one", "--switch", "zones=tool"],
            2,
            "--random-protocol and --switch are for --curves: give a file, or leave them out",
        ),
        (
            ["one", "--curves", "a.npz"],
            2,
            "--curves a.npz is judged alone, and printed: leave runs and --output out",
        ),
        (["new"], 2, "run runs/new has no trained episodes yet: leave it out"),
        (["one", "two"], 2, "runs runs/one and runs/two are both ppo on hard with seed 1: leave one of them out"),
        (
            ["one", "--output", "runs/one/config.yaml"],
            2,
            "--output runs/one/config.yaml: File exists: give a folder that can be made",
        ),
    ],
)
def test_what_cannot_be_is_one_line(runs, arguments, code, text):
    result = railctl(*arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr.splitlines() == [f"railctl: {text}"]


@pytest.mark.usefixtures("tasks_here")
def test_damaged_rows_are_one_line(runs):
    Path("runs/one/episodes.jsonl").write_text("{}\n")
    result = railctl("one")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr.startswith("railctl: runs/one/episodes.jsonl line 1 is not a valid row: ")
