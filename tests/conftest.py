"""For all tests: numerics get one thread, and arithmetic that repeats; both must be set before torch is imported."""

import gc
import os
import shutil
import signal
import tempfile

import pytest
from hypothesis import settings
from xdist.scheduler import LoadFileScheduling

from railctl.deploy.plan import ENVIRONMENT

os.environ.update(ENVIRONMENT)
signal.signal(signal.SIGINT, signal.default_int_handler)  # who is started in a shell's background ignores it
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # who is started by nohup ignores it
settings.register_profile("any machine", deadline=None)  # however busy it is
settings.load_profile("any machine")


class RealClustersTogether(LoadFileScheduling):
    """The tests of a file share a worker, and so do all real clusters: two at once take more than twice as long."""

    def _split_scope(self, nodeid):
        return "system" if nodeid.startswith(("tests/system/", "tests/chaos/")) else super()._split_scope(nodeid)


def pytest_xdist_make_scheduler(config, log):
    return RealClustersTogether(config, log) if config.option.dist == "loadfile" else None


def pytest_collection_finish():
    gc.freeze()  # libraries and thousands of tests stay: to look through them over and over takes a quarter of the time


@pytest.fixture(scope="session", autouse=True)
def own_sockets(tmp_path_factory):
    """Sockets that a test leaves behind go at the end; their paths must be short, and those of tests are not."""
    tmp_path_factory.getbasetemp()  # where it was
    before, folder = os.environ.get("TMPDIR"), tempfile.mkdtemp(prefix="railctl-tests-")
    os.environ["TMPDIR"] = tempfile.tempdir = folder
    yield
    tempfile.tempdir = before
    if before is None:
        del os.environ["TMPDIR"]
    else:
        os.environ["TMPDIR"] = before
    shutil.rmtree(folder)
