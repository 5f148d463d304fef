"""railctl list: a line for each run, whatever state it is in."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import railctl
from made_rows import episode_row

from railctl.common.folder import Outcome, RunFolder
from railctl.common.locks import sole
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import RowFile
from railctl.deploy.commands.list import DAY_S, _ago
from railctl.deploy.launch import save_config
from railctl.deploy.resolve import resolve


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path / "runs"


def make(root, name, returns=(), **given):
    folder = RunFolder(root / name)
    folder.path.mkdir(parents=True)
    save_config(folder, resolve({"episodes": 40} | given))
    file = RowFile(folder.episodes_file, EpisodeRow)
    for number, value in enumerate(returns):
        file.append(episode_row(number, normalised_return=value))
    file.close()
    return folder


def listed():
    return {run["run"]: run for run in json.loads(railctl("list", "--json").stdout)["runs"]}


def test_without_runs_it_says_how_to_start_one(root):
    assert railctl("list").stdout == f"there are no runs in {root}: start one with railctl up\n"
    assert listed() == {}


def test_a_run_is_told_in_a_line(root):
    make(root, "one", [-1.0] + [-0.25] * 100, algorithm="ppo", lag=3, seed=7)
    head, line = railctl("list").stdout.splitlines()
    assert head.split() == ["run", "state", "algorithm", "levels", "lag", "seed", "episodes", "return(100)", "changed"]
    assert line.split()[:8] == ["one", "stopped", "ppo", "easy", "3", "7", "101/40", "-0.250"]
    assert listed()["one"]["levels"] == ["easy"]


def test_a_reader_that_goes_is_no_error(root):
    make(root, "one")
    command = [Path(sys.executable).with_name("railctl"), "list"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 0


def test_names_are_never_cut(root):
    name = "a-run-with-a-very-long-name-" * 3
    make(root, name)
    assert name in railctl("list").stdout


def test_states_are_those_of_locks_and_files(root):
    running, paused, alone, done = (make(root, name) for name in ("running", "paused", "alone", "done"))
    paused.paused_file.touch()
    done.outcome_file.write_text(Outcome(outcome="finished", reason="").model_dump_json())
    with sole(running, "supervisor"), sole(paused, "supervisor"), sole(alone, "learner"):
        found = {name: run["state"] for name, run in listed().items()}
    assert found == {"running": "running", "paused": "paused", "alone": "unsupervised", "done": "finished"}


def test_a_run_that_cannot_be_read_hides_no_other(root):
    folder = make(root, "broken")
    folder.config_file.write_text("xyzzy: 1\n")
    make(root, "torn").episodes_file.write_text("nonsense\n")
    folder = make(root, "folder")
    folder.episodes_file.unlink()
    folder.episodes_file.mkdir()
    make(root, "whole")
    assert {name: run["state"] for name, run in listed().items()} == {
        "broken": "unreadable",
        "folder": "unreadable",
        "torn": "unreadable",
        "whole": "stopped",
    }
    problems = [line for line in railctl("list").stdout.splitlines() if line.startswith("! ")]
    assert [line.split(": ")[0] for line in problems] == ["! broken", "! torn", "! folder"]
    assert problems[-1] == f"! folder: {folder.episodes_file}: Is a directory: restore it"


def test_the_newest_is_last(root):
    for age, name in enumerate(("third", "second", "first")):
        then = time.time() - 3600 * (3 - age)
        os.utime(make(root, name).config_file, (then, then))
    assert list(listed()) == ["third", "second", "first"]


def test_what_is_old_is_told_in_days():
    assert _ago(2 * DAY_S - 1) == "47:59:59 ago"
    assert _ago(2 * DAY_S) == "2 days ago"
