"""The tests' own clusters: nothing that they started is left, whatever state it is in."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("detached", [False, True])
def test_what_has_no_lock_yet_ends_too(clusters, tmp_path, detached):
    others = type(clusters)(tmp_path)
    waits = [sys.executable, "-c", "import signal; signal.pause()"]
    with subprocess.Popen(waits, env=others.environment, start_new_session=detached) as process:
        others.end()
        assert process.wait(30) == -9
