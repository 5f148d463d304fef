"""Workers end with the process that started them, however that ends and whatever they do."""

import os
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from railctl.common.interpreter import PYTHON, run_module

ROOT = Path(__file__).parents[3]
MAY_OUTLIVE = {"deploy/launch.py", "deploy/plan.py"}  # the processes of a run, which goes on in the background
PATIENCE_S = 60.0
# Holds the interpreter as compiled code does: no thread runs, no handler of Python is called.
BUSY = """
import ctypes, signal, socket, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
wire = socket.socket(socket.AF_UNIX)
wire.connect(sys.argv[1])
wire.send(b"works")
while True:
    ctypes.PyDLL(None).sleep(1000)
"""
CALLERS = {
    "task": "from railctl.deploy import task; task.END_PATIENCE_S = 0.1; task.run_task('busy', sys.argv[1])",
    "task beside others": "from railctl.deploy.task import Task; t = Task('busy', sys.argv[1]); signal.pause()",
    "worker of a worker": "from railctl.deploy.task import run_task; run_task('between', sys.argv[1])",
    "bench": (
        "from railctl.deploy.commands import bench; bench.END_PATIENCE_S = 0.1; "
        "bench._run(bench.run_worker('busy', sys.argv[1]))"
    ),
}


@pytest.fixture
def listener(tmp_path: Path, monkeypatch):
    (tmp_path / "busy.py").write_text(BUSY)
    (tmp_path / "between.py").write_text(f"import sys; {CALLERS['task']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(ROOT)]))
    with socket.socket(socket.AF_UNIX) as listening:
        listening.settimeout(PATIENCE_S)
        listening.bind(str(tmp_path / "wire"))
        listening.listen()
        yield listening


@pytest.mark.parametrize(
    ("caller", "number"),
    [
        ("task", signal.SIGKILL),
        ("task", signal.SIGTERM),
        ("task", signal.SIGHUP),
        ("task", signal.SIGINT),
        ("task beside others", signal.SIGKILL),
        ("worker of a worker", signal.SIGKILL),
        ("bench", signal.SIGKILL),
        ("bench", signal.SIGTERM),
    ],
)
def test_a_worker_that_hears_nothing_ends_when_who_started_it_does(listener, caller, number):
    script = f"import signal, sys; {CALLERS[caller]}"
    command = [*PYTHON, "-c", script, listener.getsockname()]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        wire, _ = listener.accept()
        with wire:
            wire.settimeout(PATIENCE_S)
            assert wire.recv(5) == b"works"
            process.send_signal(number)
            assert wire.recv(1) == b""  # the kernel closed its end


def test_a_worker_whose_parent_is_gone_before_it_begins_does_not_begin(listener):
    stranger = "1"
    done = subprocess.run(run_module("railctl.common.worker", stranger, "busy", listener.getsockname()), check=False)
    assert done.returncode == -signal.SIGKILL


def test_only_the_processes_of_runs_are_started_to_outlive_who_starts_them():
    sources = [path for part in ("common", "services", "deploy", "analysis") for path in (ROOT / part).rglob("*.py")]
    starting = {str(path.relative_to(ROOT)) for path in sources if " import run_module" in path.read_text()}
    assert starting == MAY_OUTLIVE
