"""Work in a process of its own: its result, its progress and its end."""

import os
from pathlib import Path

import pytest

from railctl.common.strict import ConfigError
from railctl.deploy.follow import wait_until
from railctl.deploy.runs import Failed
from railctl.deploy.task import Task, run_task, time_left

SAYS = """
import json, sys
for done in (0, 1, 2):
    print(json.dumps({"progress": {"of": sys.argv[1], "done": done, "total": 2, "seconds_left": 3.0}}))
print("a remark", file=sys.stderr)
print(json.dumps({"result": sys.argv[2:]}))
"""


@pytest.fixture
def module(monkeypatch, tmp_path: Path):
    """Makes a module that can be run, and returns its name."""
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")

    def make(script: str) -> str:
        (tmp_path / "worker.py").write_text(script)
        return "worker"

    return make


def test_the_last_document_is_the_result_and_progress_goes_to_stderr(module, capfd):
    assert run_task(module(SAYS), "levels", "a", "b") == {"result": ["a", "b"]}
    out, err = capfd.readouterr()
    assert (out, err.splitlines()) == ("", ["levels: 0 of 2 3 s left", "levels: 2 of 2"])


@pytest.mark.parametrize(
    ("script", "error", "text"),
    [
        ("import sys; print('first', file=sys.stderr); sys.exit('the reason')", Failed, "the reason"),
        ("import sys; print('no such thing', file=sys.stderr); sys.exit(2)", ConfigError, "no such thing"),
        ("import os; os.kill(os.getpid(), 9)", Failed, "worker was killed: run it again"),
    ],
)
def test_an_end_in_failure_says_why(module, script, error, text):
    with pytest.raises(error) as ended:
        run_task(module(script))
    assert str(ended.value) == text


def test_a_task_beside_others_says_nothing_but_its_result(module, capfd):
    task = Task(module(SAYS), "levels", "a", "b")
    assert wait_until(task.has_ended, 30)
    assert task.result() == {"result": ["a", "b"]}
    assert capfd.readouterr() == ("", "")


def test_a_task_beside_others_fails_as_any_other(module):
    with pytest.raises(Failed, match="the reason"):
        Task(module("import sys; sys.exit('the reason')")).result()


def test_a_task_can_be_ended(module):
    task = Task(module("import signal; signal.pause()"))
    assert not task.has_ended()
    task.end()
    with pytest.raises(Failed, match="worker was killed: run it again"):
        task.result()


def test_time_left_as_people_say_it():
    assert [time_left(seconds) for seconds in (75.2, 8.0, None)] == ["1 min 15 s left", "8 s left", ""]
