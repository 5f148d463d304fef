"""How many cases a property is tried on: a few in `make test`, as many as one likes in `make fuzz`."""

import os

import pytest
from hypothesis import settings

FUZZ_CASES = "RAILCTL_FUZZ_CASES"  # of each property
fuzz = pytest.mark.fuzz


def cases(few: int) -> settings:
    """So many, unless more are asked for."""
    return settings(max_examples=int(os.environ.get(FUZZ_CASES, few)))
