"""Our own exp, tanh, sigmoid and log against the library's, in units of float32's last place."""

import math

import numpy as np
import pytest

from common.policy import arithmetic

CASES = [
    (arithmetic.exp, np.exp, np.linspace(-80, 80, 4001)),
    (arithmetic.tanh, np.tanh, np.concatenate([np.linspace(-12, 12, 4001), np.logspace(-30, 0, 500)])),
    (arithmetic.sigmoid, lambda x: 1 / (1 + np.exp(-x)), np.linspace(-80, 80, 4001)),
    (arithmetic.log, np.log, np.logspace(-30, 30, 4001)),
]


@pytest.mark.parametrize(("ours", "theirs", "x"), CASES, ids=["exp", "tanh", "sigmoid", "log"])
def test_results_are_those_of_the_library_to_float32(ours, theirs, x):
    x = x.astype(np.float32).astype(np.float64)
    got = np.array([ours(value) for value in x]).astype(np.float32)
    expected = theirs(x).astype(np.float32)
    assert (np.abs(got - expected) <= np.spacing(np.abs(expected))).all()
    assert (got == expected).mean() > 0.999


def test_arguments_beyond_float32_do_not_overflow():
    assert arithmetic.exp(1e6) == arithmetic.exp(104.0) < math.inf
    assert 0 < arithmetic.exp(-1e6) < 2**-149
    assert (arithmetic.tanh(1e6), arithmetic.tanh(-1e6), arithmetic.tanh(0.0)) == (1, -1, 0)
    assert (np.float32(arithmetic.sigmoid(1e6)), np.float32(arithmetic.sigmoid(-1e6))) == (1, 0)


@pytest.mark.parametrize("name", ["exp", "tanh", "sigmoid", "log"])
def test_plain_python_gives_the_same_bits(name):
    compiled = getattr(arithmetic, name)
    for x in (0.1, 0.7, 1.5, 3.25, 17.0):
        assert compiled.py_func(x) == compiled(x)
