"""railctl demonstrate, from the command line to the file."""

import json
from functools import partial
from pathlib import Path

import command_line
import pytest

from railctl.common.demonstrations import read_demonstrations


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", "runs")
    monkeypatch.chdir(tmp_path)


railctl = partial(command_line.railctl, "demonstrate")


def test_a_file_is_written_in_the_world_of_a_run(here):
    Path("run.yaml").write_text(
        "algorithm: sil\nlevel: easy\nseed: 3\ninterlocking: planned\ndemonstrations: some.demos\n"
    )
    result = railctl("shortest-path-planned", "-f", "run.yaml", "--episodes", 2, "--out", "some.demos", "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    heading, courses = read_demonstrations(Path("some.demos"))
    assert (document["policy"], document["episodes"]) == (heading.policy, heading.episodes)
    assert document["decisions"] == sum(len(course.decisions) for course in courses)
    assert "episodes: 2 of 2" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["planner", "--episodes", "0"], "--episodes 0: use 1 to 1000000"),
        (["planner", "--orders", "0"], "--orders 0: use 1 to 100000"),
        (["planner", "--sample"], "--sample: planner is no network whose actions could be drawn, or the best"),
        (["shortest-path-planned", "--orders", "3"], "--orders: only planners try orders of trains"),
        (["planner", "--out", "run.yaml"], "--out run.yaml: exists already: give another name"),
        (["planner", "--out", "nowhere.demos"], "--out nowhere.demos: exists already: give another name"),
        (["planner", "--out", "no/some.demos"], "--out no/some.demos: there is no folder no: make it first"),
        (["planr"], "no file planr, and no run named 'planr'"),
        (["planner", "--set", "interlocking=planned"], "planner: an interlocking (planned) may forbid"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(arguments, text):
    Path("run.yaml").write_text("")
    Path("nowhere.demos").symlink_to("nowhere")
    out = [] if "--out" in arguments else ["--out", "some.demos"]
    result = railctl(*arguments, *out)
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-1].startswith(f"railctl: {text}")
    assert not Path("some.demos").exists()
