"""The interval of a mean."""

import numpy as np
import pytest

from railctl.analysis.statistics import mean_interval


def test_two_values_reach_as_far_as_they_do():
    assert mean_interval(np.array([-1.0, -0.5])) == (-1.0, -0.5)  # each end is the mean of one sample in four


def test_equal_values_leave_no_doubt():
    assert mean_interval(np.full(8, -0.25)) == (-0.25, -0.25)


def test_a_bell_has_the_interval_of_the_normal_law():
    values = np.linspace(-1, 0, 601)  # sd 0.2891, so the mean's is 0.01179
    low, high = mean_interval(values)
    assert low == pytest.approx(-0.5 - 1.96 * 0.01179, abs=0.002)
    assert high == pytest.approx(-0.5 + 1.96 * 0.01179, abs=0.002)


def test_it_repeats():
    values = np.sin(np.arange(50.0))
    assert mean_interval(values) == mean_interval(values.copy())
