"""railctl doctor: it says what it does, and goes on when a check fails."""

from railctl.deploy.commands.doctor import _run
from railctl.deploy.runs import Failed


def _cores():
    return "2"


def _disk():
    raise Failed("0.1 GiB free: a run wants 1")


def test_every_check_is_said_and_told_of():
    said = []
    rows = [_run(check, said.append) for check in (_cores, _disk)]
    assert said == ["checks cores", "checks disk"]
    assert rows == [
        {"check": "cores", "ok": True, "found": "2"},
        {"check": "disk", "ok": False, "found": "0.1 GiB free: a run wants 1"},
    ]
