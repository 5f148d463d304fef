"""The metrics themselves: curves in, an array of values out.

Chan, Fishman, Canny, Korattikara & Guadarrama, "Measuring the Reliability of Reinforcement Learning Algorithms" (ICLR
2020, arXiv:1912.05663), in the definitions of their open tool (google-research/rl-reliability-metrics): where paper and
tool differ, the tool decides. Not here: ranks, and what can be said of differences.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from scipy.signal import butter, filtfilt

from railctl.analysis.reliability.curves import Curves, Floats
from railctl.analysis.reliability.switches import Switches

ALPHA = 0.05  # share of the values that make a tail
TAIL_TOLERANCE = 1e-12  # interpolated quantiles are a rounding error off values that they equal

Tail = Literal["lower", "upper"]


def interquartile_range(values: Floats, axis: int = -1) -> Floats:
    """Distance of the quartiles of an axis, which goes."""
    ordered = np.moveaxis(np.sort(values, axis=axis), axis, 0)
    return np.asarray(_quantile(ordered, 0.75) - _quantile(ordered, 0.25))


def tail_mean(values: Floats, tail: Tail) -> Floats:
    """Conditional value at risk: mean of the last axis' values at or beyond its 5% (95%) quantile; one axis less.

    Of no values it is nan. As in the original, nan counts as the highest value.
    """
    if values.shape[-1] == 0:
        return np.full(values.shape[:-1], np.nan)
    ordered = np.moveaxis(np.sort(values, axis=-1), -1, 0)
    if tail == "lower":
        within = values <= _quantile(ordered, ALPHA)[..., None] + TAIL_TOLERANCE
    else:
        within = values >= _quantile(ordered, 1 - ALPHA)[..., None] - TAIL_TOLERANCE
    return np.asarray(np.where(within, values, 0).sum(-1) / within.sum(-1))


def drawdown(curve: Floats) -> Floats:
    """How far a curve (last axis) lies below the highest that it was; same shape, 0 or above."""
    return np.asarray(np.maximum.accumulate(curve, axis=-1) - curve)


def moving_average(curve: Floats, window: int) -> Floats:
    """Mean of every `window` values in a row: [..., N] to [..., N - window + 1]."""
    sums = np.concatenate([np.zeros((*curve.shape[:-1], 1)), curve.cumsum(-1)], axis=-1)
    return np.asarray((sums[..., window:] - sums[..., :-window]) / window)


def lowpass(curve: Floats) -> Floats:
    """Filtered forwards and backwards by a Butterworth filter of order 8 at 1% of the Nyquist frequency; same shape."""
    numerator, denominator = butter(8, 0.01)
    padding = min(curve.shape[-1] - 1, 3 * len(denominator))
    return np.asarray(filtfilt(numerator, denominator, curve, padlen=padding))


def curve_ranges(curves: Curves, switches: Switches) -> Floats | None:
    """What every run [A, K, R] is divided by: 95th percentile minus start, of its episodes or blocks."""
    if switches.normalize == "none":
        return None
    curve = curves.returns if switches.normalize == "curve_range" else curves.means
    return np.asarray(np.percentile(curve, 95, axis=-1) - curve[..., 0])


def dispersion_across_time(curves: Curves, switches: Switches) -> Floats:
    """DT [A, K, R, P]: interquartile range of the differences within a block; not detrended, of its returns."""
    spread = interquartile_range(np.diff(curves.blocks) if switches.dt_detrend else curves.blocks)
    ranges = curve_ranges(curves, switches)
    return spread if ranges is None else spread / ranges[..., None]


def median_performance(curves: Curves, _: Switches) -> Floats:
    """MEDPERF [A, K, R, P]: median return of a block."""
    return np.asarray(np.median(curves.blocks, axis=-1))


def short_term_risk(curves: Curves, switches: Switches) -> Floats:
    """SRT [A, K, R]: mean of the worst steps from one point of the curve to the next."""
    return tail_mean(np.diff(_risk_curve(curves, switches)), "lower")


def long_term_risk(curves: Curves, switches: Switches) -> Floats:
    """LRT [A, K, R]: mean of the deepest drawdowns."""
    return tail_mean(drawdown(_risk_curve(curves, switches)), switches.drawdown_tail)


def points_across_runs(curves: Curves, switches: Switches) -> Floats:
    """What DR compares runs by [A, K, R, P]."""
    return _at_points(curves.returns, curves) if switches.lowpass else curves.means


def dispersion_of_runs(points: Floats, ranges: Floats | None) -> Floats:
    """Interquartile range over runs: [..., R, P], and what to divide by [..., R], to [..., P]."""
    spread = interquartile_range(points, axis=-2)
    return spread if ranges is None else spread / np.median(ranges, axis=-1)[..., None]


def dispersion_across_runs(curves: Curves, switches: Switches) -> Floats:
    """DR [A, K, P]."""
    return dispersion_of_runs(points_across_runs(curves, switches), curve_ranges(curves, switches))


def risk_across_runs(curves: Curves, switches: Switches) -> Floats:
    """RR [A, K, P]: mean of the worst runs at a point."""
    curve = _normalised(curves.returns if switches.lowpass else curves.means, curves, switches)
    points = _at_points(curve, curves) if switches.lowpass else curve
    return tail_mean(np.moveaxis(points, 2, -1), "lower")


def _quantile(ordered: Floats, share: float) -> Floats:
    """Of sorted values along the first axis, linear between them."""
    place = share * (len(ordered) - 1)
    low, weight = int(place), place % 1
    if weight == 0:  # the next value may be infinite, or none
        return np.asarray(ordered[low])
    return np.asarray(ordered[low] * (1 - weight) + ordered[low + 1] * weight)


def _at_points(curve: Floats, curves: Curves) -> Floats:
    return lowpass(curve)[..., curves.block - 1 :: curves.block]


def _risk_curve(curves: Curves, switches: Switches) -> Floats:
    if switches.risk_curve == "eval_points":
        curve = curves.means
    elif switches.risk_curve == "moving_average":
        curve = moving_average(curves.returns, curves.block)
    else:
        curve = curves.returns
    return _normalised(curve, curves, switches)


def _normalised(curve: Floats, curves: Curves, switches: Switches) -> Floats:
    ranges = curve_ranges(curves, switches)
    return curve if ranges is None else curve / ranges[..., None]


class Metric(NamedTuple):
    """How values [A, K, R or not, P or not] are computed, and read."""

    of: Callable[[Curves, Switches], Floats]
    axes: str  # A algorithm, T level (task), R run, P evaluation point
    bigger_is_better: bool


METRICS = {
    "DT": Metric(dispersion_across_time, "ATRP", bigger_is_better=False),
    "DR": Metric(dispersion_across_runs, "ATP", bigger_is_better=False),
    "SRT": Metric(short_term_risk, "ATR", bigger_is_better=True),
    "LRT": Metric(long_term_risk, "ATR", bigger_is_better=False),
    "RR": Metric(risk_across_runs, "ATP", bigger_is_better=True),
    "MEDPERF": Metric(median_performance, "ATRP", bigger_is_better=True),
}
