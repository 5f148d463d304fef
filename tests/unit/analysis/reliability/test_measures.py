"""Metrics, worked by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from railctl.analysis.reliability import Curves, Switches
from railctl.analysis.reliability.measures import (
    METRICS,
    dispersion_of_runs,
    drawdown,
    interquartile_range,
    lowpass,
    moving_average,
    tail_mean,
)
from railctl.analysis.reliability.zones import penalties_by_zone, zone_points

RETURNS = st.integers(-64, 0).map(lambda number: number / 64)


def value(curves, metric, **switches):
    return METRICS[metric].of(curves, Switches(**switches)).ravel().tolist()


def test_quartiles_are_linear_between_values():
    assert interquartile_range(np.array([4.0, 1, 3, 2])) == 3.25 - 1.75
    assert interquartile_range(np.array([[1.0, 5], [2, 5], [3, 5], [4, 5]]), axis=0).tolist() == [1.5, 0]


def test_tails_hold_their_quantile():
    values = np.arange(21.0)  # quantiles 1 and 19
    assert (tail_mean(values, "lower"), tail_mean(values, "upper")) == (0.5, 19.5)
    assert np.isnan(tail_mean(np.zeros(0), "lower"))


@given(RETURNS.filter(bool), st.integers(1, 50), st.sampled_from(["lower", "upper"]))
def test_equal_values_are_all_in_the_tail(number, count, tail):
    assert tail_mean(np.full(count, number / 3), tail) == pytest.approx(number / 3)


def test_not_a_number_is_the_highest_value():
    assert tail_mean(np.array([0.5, 0.25, np.nan]), "lower") == 0.25
    with np.errstate(invalid="ignore"):
        assert np.isnan(tail_mean(np.array([0.5, 0.25, np.nan]), "upper"))


def test_drawdown_is_measured_from_the_best_so_far():
    assert drawdown(np.array([-0.5, -0.25, -0.5, 0, -1])).tolist() == [0, 0, 0.25, 0, 1]


def test_moving_average_has_full_windows_only():
    assert moving_average(np.array([1.0, 2, 6, 4]), 2).tolist() == [1.5, 4, 5]


def test_the_filter_leaves_slow_changes_and_takes_fast_ones():
    slow = np.linspace(-1, 0, 1500)
    fast = 0.1 * (-1.0) ** np.arange(1500)
    assert abs(lowpass(slow + fast) - slow)[500:1000].max() < 0.02


def test_dispersion_across_time(rising):
    # differences 0.1, 0, 0.4 and 0, 0.2, 0.2; the range of episodes -0.17 + 1, that of blocks -0.37375 + 0.825
    assert value(rising, "DT") == pytest.approx([0.2, 0.1])
    assert value(rising, "DT", normalize="curve_range") == pytest.approx([0.2 / 0.83, 0.1 / 0.83])
    assert value(rising, "DT", normalize="curve_range_block") == pytest.approx([0.2 / 0.45125, 0.1 / 0.45125])
    assert value(rising, "DT", dt_detrend=False) == pytest.approx([0.125, 0.25])
    assert value(rising, "MEDPERF") == pytest.approx([-0.9, -0.4])


def test_short_term_risk(rising):
    assert value(rising, "SRT") == pytest.approx([-0.35 + 0.825])
    assert value(rising, "SRT", risk_curve="episodes") == pytest.approx([0])
    assert value(rising, "SRT", risk_curve="moving_average") == pytest.approx([0.1])  # of 0.125, 0.1, 0.15, 0.1
    assert value(rising, "SRT", normalize="curve_range") == pytest.approx([0.475 / 0.83])


def test_long_term_risk(rising, falling):
    assert value(rising, "LRT") == [0]
    assert value(falling, "LRT") == pytest.approx([0.475])
    assert value(falling, "LRT", drawdown_tail="lower") == [0]
    assert value(falling, "LRT", risk_curve="episodes") == pytest.approx([0.9])
    assert value(falling, "LRT", risk_curve="moving_average") == pytest.approx([0.475])


def test_across_runs():
    runs = np.repeat(np.array([-1, -0.8, -0.6, -0.2])[None, None, :, None], 2, axis=-1)
    curves = Curves(runs, block=2, zones=1)
    assert value(curves, "DR") == pytest.approx([-0.5 + 0.85])
    assert value(curves, "RR") == [-1]
    points, ranges = np.array([[0.0], [1], [2], [3]]), np.array([1.0, 2, 4, 8])
    assert dispersion_of_runs(points, ranges).tolist() == [1.5 / 3]


@given(arrays(float, (1, 1, 3, 12), elements=RETURNS), st.integers(0, 64))
def test_spread_and_risk_do_not_depend_on_how_good_returns_are(returns, shift):
    curves = Curves(returns / 2, block=4, zones=1)
    shifted = Curves(returns / 2 - shift / 128, block=4, zones=1)
    for metric in ("DT", "DR", "SRT", "LRT"):
        np.testing.assert_allclose(value(curves, metric), value(shifted, metric), atol=1e-12)


def test_zones_are_even_only_if_points_start_at_0():
    def sizes(points, zones):
        return [len(zone) for zone in zone_points(points, zones)]

    assert zone_points(list(range(0, 1500, 100)), 3) == [[*range(5)], [*range(5, 10)], [*range(10, 15)]]
    assert sizes(list(range(100, 1600, 100)), 3) == [4, 5, 6]
    assert sizes(list(range(10)), 3) == [3, 3, 4]
    assert sizes([1, 2, 3], 3) == [0, 1, 2]  # where the original ends with an error


def test_a_zone_is_the_median_or_mean_of_its_points():
    values = np.array([[[1.0, 2, 6, 7]]])
    zones = {"zone0": [0, 1, 2], "zone1": [3], "zone2": []}
    for collapse, expected in (("median", 2), ("mean", 3)):
        worse = penalties_by_zone(values, "DR", zones, Switches(zone_collapse=collapse))
        assert (worse["zone0"].item(), worse["zone1"].item()) == (expected, 7)
        assert np.isnan(worse["zone2"]).all()
