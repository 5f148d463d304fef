"""What processes cost, as `/proc` tells."""

import os
import subprocess

from railctl.common.interpreter import PYTHON
from railctl.tools.bench.processes import Watch

BUSY = """
import time
held = bytearray(b"x" * 60_000_000)
while time.process_time() < 0.7:
    pass
print("done", flush=True)
input()
"""


def test_time_and_memory_of_processes_that_name_the_folder_are_counted(tmp_path):
    environment = os.environ | {"RAILCTL_RUNS": str(tmp_path)}
    with Watch(str(tmp_path)) as watch:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with subprocess.Popen([*PYTHON, "-c", BUSY], env=environment, **pipes) as busy:
            assert busy.stdout.readline() == b"done\n"
            while watch.cpu_s < 0.6:  # until it has been looked at
                assert busy.poll() is None
            busy.communicate(b"\n")
    assert 0.6 <= watch.cpu_s < 10
    assert 60e6 < watch.peak_bytes < 1e9


def test_other_processes_are_not(tmp_path):
    with Watch(str(tmp_path)) as watch:
        subprocess.run([*PYTHON, "-c", "pass"], check=True)
    assert (watch.cpu_s, watch.peak_bytes) == (0, 0)
