"""For all tests: numerics get one thread, and arithmetic that repeats; both must be set before torch is imported."""

import os

from xdist.scheduler import LoadFileScheduling

from deploy.plan import ENVIRONMENT

os.environ.update(ENVIRONMENT)


class RealClustersTogether(LoadFileScheduling):
    """The tests of a file share a worker, and so do all real clusters: two at once take more than twice as long."""

    def _split_scope(self, nodeid):
        return "system" if nodeid.startswith("tests/system/") else super()._split_scope(nodeid)


def pytest_xdist_make_scheduler(config, log):
    return RealClustersTogether(config, log)
