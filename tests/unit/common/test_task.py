"""What a process that does one thing for the command line says."""

import json

import pytest

from railctl.common import task
from railctl.common.compile_signs import compiling
from railctl.common.strict import ConfigError
from railctl.common.task import Teller, carry_out


@pytest.fixture
def at(monkeypatch):
    """Sets the time."""
    return lambda now: monkeypatch.setattr(task.time, "monotonic", lambda: now)


def test_progress_is_told_now_and_then_and_at_the_end(at, capsys):
    teller = Teller("levels")
    for now, done in ((0.0, 0), (5.0, 1), (5.09, 2), (7.0, 5), (7.01, 9)):
        at(now)
        teller.tell(done, 9)
    told = [json.loads(line)["progress"] for line in capsys.readouterr().out.splitlines()]
    assert [list(progress) for progress in told] == [["of", "done", "total", "seconds_left"]] * 4
    assert [(progress["done"], progress["seconds_left"]) for progress in told] == [
        (0, None),
        (1, None),  # preparing took the five seconds
        (5, 2.0),  # four more in two seconds
        (9, 0.0),
    ]
    assert {(progress["of"], progress["total"]) for progress in told} == {("levels", 9)}


def failing(error):
    def work():
        raise error

    return work


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (ConfigError("no such thing"), 2, "no such thing"),
        (KeyError("lost"), 1, "'lost'"),
        (PermissionError(13, "Permission denied", "file"), 1, "file: Permission denied"),
        (OSError(28, "No space", "source"), 1, "No space: make room on the disk, then run it again"),
    ],
)
def test_what_goes_wrong_is_one_line_and_an_exit_code(caplog, error, code, text):
    with pytest.raises(SystemExit) as ended:
        carry_out(failing(error), KeyError)
    assert ended.value.code == code
    assert caplog.messages == [text]


def test_errors_that_nobody_expected_are_not_hidden():
    with pytest.raises(IndexError):
        carry_out(failing(IndexError("oh")), KeyError)


def test_compiling_is_told_as_it_goes_on(capsys):
    def work():
        for function in ("step", "look"):
            with compiling(function):
                pass

    carry_out(work)
    told = [json.loads(line)["progress"] for line in capsys.readouterr().out.splitlines()]
    assert [(progress["of"], progress["done"], progress["total"]) for progress in told] == [
        ("compiling, the first time only", 1, None),
        ("compiling, the first time only", 2, None),
    ]
