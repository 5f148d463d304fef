"""What docs/python.md, docs/export.md and the docstrings of the Python interface show is true, with a real run."""

import doctest
import re
import subprocess
from pathlib import Path

import pytest

import railctl
import railctl.api
from railctl.common.interpreter import PYTHON

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """A folder for runs."""
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "runs"


@pytest.mark.parametrize(("module", "examples"), [(railctl, 4), (railctl.api, 7)])
def test_examples_in_docstrings_are_true(runs, module, examples):
    failed, attempted = doctest.testmod(module)
    assert failed == 0
    assert attempted >= examples


def test_the_document_shows_what_comes_out(runs):
    text = (DOCS / "python.md").read_text()
    code, shown = re.search(r"```python\n(.*?)```\n\n```\n(.*?)```", text, re.DOTALL).groups()
    done = subprocess.run([*PYTHON, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, shown), done.stderr
    assert railctl.open_run("small").state == "finished"


def test_ctrl_c_stops_a_run_cleanly_and_it_goes_on(runs):
    heard = []

    def interrupt(row):
        heard.append(row)
        if len(heard) == 5:
            raise KeyboardInterrupt

    options = {"name": "cut", "evaluation": {"every_episodes": 20, "levels": 2}}
    with pytest.raises(KeyboardInterrupt):
        railctl.train("dddqn", "easy", episodes=40, on_row=interrupt, **options)
    run = railctl.open_run("cut")
    assert run.state == "stopped"
    assert 5 <= len(run.rows()) <= 40
    rows = []
    assert railctl.train(name="cut", on_row=rows.append).state == "finished"
    assert [row.episode for row in rows if hasattr(row, "actor")] == list(range(40))
    assert [run.name for run in railctl.runs()] == ["cut"]
    assert run.policy().episode == 40
    assert run.curve()[1].shape == (40,)
    assert run.metrics()[-1].episode == 39


def test_a_run_that_cannot_be_is_refused_before_anything_starts(runs):
    with pytest.raises(railctl.ConfigError, match="unknown algorithm 'nope'"):
        railctl.train("nope")
    assert railctl.runs() == []
