"""For all tests: numerics get one thread, and arithmetic that repeats; both must be set before torch is imported."""

import os

import pytest

from deploy.plan import ENVIRONMENT

os.environ.update(ENVIRONMENT)


@pytest.hookimpl(tryfirst=True)  # what spreads the tests over workers reads it
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The tests of a file share a worker, and so do all real clusters: two at once take more than twice as long."""
    for item in items:
        group = "system" if "system" in item.path.parts else item.path.stem
        item.add_marker(pytest.mark.xdist_group(group))
