"""The original tool's own numbers for made-up curves: see `docs/reliability.md`, "How it is checked"."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from railctl.analysis.reliability import Curves
from railctl.analysis.reliability.files import load

DATA = Path(__file__).parent / "data"


@pytest.fixture(scope="session")
def oracle():
    """Curves of a case, and what the tool says of them."""
    cases = {}
    for name in ("tiny", "main"):
        said = json.loads(gzip.decompress((DATA / f"{name}.json.gz").read_bytes()))
        cases[name] = load(DATA / f"{name}.npz"), said
    return cases


@pytest.fixture(scope="session")
def rising():
    """One run of two blocks, which never falls."""
    return Curves(np.array([[[[-1, -0.9, -0.9, -0.5, -0.5, -0.5, -0.3, -0.1]]]]), block=4, zones=1)


@pytest.fixture(scope="session")
def falling(rising):
    return Curves(rising.returns[..., ::-1], block=4, zones=1)
