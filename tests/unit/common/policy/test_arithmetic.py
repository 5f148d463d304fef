"""Our own exp, tanh, sigmoid and log against the library's, in units of float32's last place."""

import math

import numpy as np
import pytest

from railctl.common.policy import arithmetic

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


@pytest.mark.parametrize("exponent", [0.0, 0.4, 0.5, 0.6, 1.0, 2.5, -1.0])
def test_powers_are_those_of_the_library(exponent):
    x = np.concatenate([np.logspace(-6, 6, 4001), np.linspace(0.5, 2, 501)])
    np.testing.assert_allclose([arithmetic.power(value, exponent) for value in x], x**exponent, rtol=1e-14)


def test_powers_by_hand():
    assert [arithmetic.power(1.0, exponent) for exponent in (-3.0, 0.0, 0.3, 1e300)] == [1, 1, 1, 1]
    assert [arithmetic.power(x, 0.0) for x in (0.0, 5e-324, 0.1, 1e308, math.inf)] == [1, 1, 1, 1, 1]
    assert [arithmetic.power(4.0, exponent) for exponent in (-1.0, 0.5, 1.0, 3.0)] == [0.25, 2, 4, 64]


def test_powers_are_bounded():
    assert arithmetic.power(0.0, 1.0) == arithmetic.power(2.0**-1022, 1.0) == 2.0**-1021
    assert arithmetic.power(0.0, 0.5) == arithmetic.power(5e-324, 0.5) == 2.0**-511
    assert arithmetic.power(1e300, 9.0) == arithmetic.power(math.inf, 1.0) == 2.0**1021
    assert arithmetic.power(1e300, -9.0) == 2.0**-1021


@pytest.mark.parametrize("name", ["exp", "tanh", "sigmoid", "log"])
def test_plain_python_gives_the_same_bits(name):
    compiled = getattr(arithmetic, name)
    for x in (0.1, 0.7, 1.5, 3.25, 17.0):
        assert compiled.py_func(x) == compiled(x)


def test_plain_python_gives_the_same_powers():
    for x in (0.0, 1e-6, 0.1, 0.7, 1.5, 3.25, 1e150):
        for exponent in (-0.4, 0.0, 0.6, 1.0):
            assert arithmetic.power.py_func(x, exponent) == arithmetic.power(x, exponent)
