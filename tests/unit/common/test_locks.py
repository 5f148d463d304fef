"""One living process of a name, whatever dies and how."""

import os
import signal
import subprocess
from contextlib import contextmanager

import pytest

from railctl.common import locks
from railctl.common.folder import RunFolder
from railctl.common.interpreter import PYTHON
from railctl.common.locks import RunsAlreadyError, elsewhere, holder, living, sole

HOLDER = """
import socket, sys
from pathlib import Path
from railctl.common import locks
from railctl.common.folder import RunFolder
from railctl.common.locks import sole
if len(sys.argv) == 4:
    socket.gethostname = locks._machine = lambda: sys.argv[3]
with sole(RunFolder(Path(sys.argv[1])), sys.argv[2]):
    print("holds", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path):
    return RunFolder(tmp_path)


@contextmanager
def another(folder, name, *machine):
    """A process that holds a name until its input ends, perhaps as if on another machine."""
    with subprocess.Popen(
        [*PYTHON, "-c", HOLDER, str(folder.path), name, *machine],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout.readline() == "holds\n"
            yield process
        finally:
            process.kill()


def test_nobody_lives_in_a_new_run(folder):
    assert living(folder) == {}
    assert holder(folder, "learner") is None
    assert not folder.processes.exists()  # looking leaves nothing behind


def test_what_is_no_file_is_held_by_nobody_and_keeps_nobody_waiting(folder):
    folder.processes.mkdir()
    os.mkfifo(folder.processes / "supervisor")
    (folder.processes / "learner").mkdir()
    (folder.processes / "evaluator").symlink_to("evaluator")
    assert (living(folder), elsewhere(folder)) == ({}, None)


def test_a_name_is_held_for_as_long_as_the_block_lasts(folder):
    with sole(folder, "learner"):
        assert holder(folder, "learner") == os.getpid()
        assert living(folder) == {"learner": os.getpid()}
        assert holder(folder, "actor-easy-0") is None
    assert holder(folder, "learner") is None
    assert living(folder) == {}


def test_a_name_is_free_after_an_error(folder):
    with pytest.raises(ZeroDivisionError), sole(folder, "learner"):
        _ = 1 / 0
    with sole(folder, "learner"):
        assert holder(folder, "learner") == os.getpid()


def test_a_second_process_of_a_name_is_turned_away(folder, monkeypatch):
    monkeypatch.setattr(locks, "PATIENCE_S", 0.05)
    with another(folder, "learner") as process:
        with pytest.raises(RunsAlreadyError) as caught, sole(folder, "learner"):
            pass
        assert str(caught.value) == f"learner of {folder.path.name} runs already, as process {process.pid}"
        assert holder(folder, "learner") == process.pid  # it was not disturbed
        with sole(folder, "evaluator"):
            assert living(folder) == {"evaluator": os.getpid(), "learner": process.pid}


def test_the_name_of_a_killed_process_is_free(folder):
    with another(folder, "learner") as process:
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert living(folder) == {}
        with sole(folder, "learner"):
            assert holder(folder, "learner") == os.getpid()


def test_a_process_that_ends_in_time_makes_way(folder):
    with another(folder, "learner") as process:
        process.stdin.close()
        with sole(folder, "learner"):
            assert holder(folder, "learner") == os.getpid()


def test_a_probe_does_not_turn_a_process_away(folder, monkeypatch):
    """`holder` takes a shared lock for an instant: `sole` must wait for it."""
    folder.processes.mkdir()
    probe = (folder.processes / "learner").open("a+")
    locks.fcntl.flock(probe, locks.fcntl.LOCK_SH)
    waits = []

    def end_the_probe(seconds):
        waits.append(seconds)
        probe.close()

    monkeypatch.setattr(locks.time, "sleep", end_the_probe)
    with sole(folder, "learner"):
        assert len(waits) == 1


def test_probes_do_not_take_each_other_for_holders(folder):
    folder.processes.mkdir()
    (folder.processes / "learner").write_text("77")  # of a process that was killed
    with (folder.processes / "learner").open("r") as probe:
        locks.fcntl.flock(probe, locks.fcntl.LOCK_SH)
        assert holder(folder, "learner") is None


def test_a_child_does_not_inherit_a_name(folder):
    with sole(folder, "supervisor"):
        child = subprocess.Popen([*PYTHON, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE)
    with child:
        assert holder(folder, "supervisor") is None
        child.stdin.close()


def test_a_lock_whose_content_is_no_pid_names_nobody(folder):
    folder.processes.mkdir()
    with (folder.processes / "learner").open("w") as file:
        locks.fcntl.flock(file, locks.fcntl.LOCK_EX)
        assert holder(folder, "learner") is None
        file.write("half a")
        file.flush()
        assert holder(folder, "learner") is None


def test_a_pid_of_another_machine_means_nothing_here(folder, monkeypatch):
    monkeypatch.setattr(locks, "PATIENCE_S", 0.05)
    with sole(folder, "evaluator"):
        assert elsewhere(folder) is None
        with another(folder, "learner", "node7"):
            assert holder(folder, "learner") is None
            assert living(folder) == {"evaluator": os.getpid()}
            assert elsewhere(folder) == "node7"
            with pytest.raises(RunsAlreadyError, match="runs already, on node7"), sole(folder, "learner"):
                pass
        assert elsewhere(folder) is None


def test_a_process_of_an_earlier_version_lives_here(folder):
    with sole(folder, "learner"):
        (folder.processes / "learner").write_text(str(os.getpid()))
        assert holder(folder, "learner") == os.getpid()
        assert elsewhere(folder) is None
