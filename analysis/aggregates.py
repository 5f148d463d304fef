"""What a sample of runs says of algorithms: robust aggregates, comparisons and ranks, with their 95% intervals.

"Deep Reinforcement Learning at the Edge of the Statistical Precipice", Agarwal et al. 2021 (arXiv:2108.13264), whose
tool is rliable; ranks and the paired test are not in it. Scores of an algorithm are [R, K]: R runs on each of K levels,
higher is better. Intervals are percentiles of a stratified bootstrap: on every level runs are drawn anew from its own.
They speak of other runs on the same levels, not of other levels, and are too narrow if runs are but a few. Of a single
run nothing can be said about others: an interval then is nan to nan, and so are ranks.

Equal inputs have equal outputs: draws are keyed by how many runs there are, so what is said of an algorithm alone does
not depend on the others. Scores that are empty, not finite, not [R, K] or not of the levels of the first algorithm are
a ValueError that names theirs.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from railctl.analysis.statistics import RESAMPLES, SHARE
from railctl.common.seeding import stream_key

Floats = NDArray[np.float64]
Scores = Mapping[str, Floats]

DECIMALS = 10  # differences below are of rounding: such means are ties
CLOSE = 1e-9  # likewise, of sums


class Estimate(NamedTuple):
    """A figure and its 95% interval."""

    value: float
    low: float
    high: float


class PairedTest(NamedTuple):
    """The mean of x - y, its 95% interval, and how probable one as far from 0 is if x and y do not differ."""

    difference: float
    low: float
    high: float
    p: float


def aggregates(scores: Scores, *, optimal: float = -0.1, reps: int = 2000) -> dict[str, dict[str, Estimate]]:
    """Of every algorithm the `mean`, `median`, `iqm` and `optimality_gap`.

    The median is that of the levels' means, and the gap how much scores lie below `optimal` in the mean, where those
    above it do not count as better. The interquartile mean (iqm) leaves out a quarter of all scores at either end.
    """
    return {name: _aggregates(values, optimal, reps) for name, values in _checked(scores).items()}


def probability_of_improvement(scores: Scores, *, reps: int = 400) -> dict[tuple[str, str], Estimate]:
    """For all X and Y: how probable a run of X is better than one of Y on the same level, mean over levels; ties half.

    It is the share of pairs in which it is (Mann & Whitney's U). The runs of X are drawn apart from those of Y.
    """
    checked = _checked(scores)
    found = {}
    for x, y in combinations(checked, 2):
        value, low, high = found[x, y] = _improvement(checked[x], checked[y], reps)
        found[y, x] = Estimate(1 - value, 1 - high, 1 - low)
    return found


def performance_profiles(scores: Scores, taus: Floats, *, reps: int = 1000) -> dict[str, tuple[Floats, Floats, Floats]]:
    """Of every algorithm the share [T] of scores above each of taus [T], and its low [T] and high [T] at each alone."""
    profiles = {}
    for name, values in _checked(scores).items():
        drawn = _drawn(values, reps)
        points = [_estimate((values > tau).mean(), (drawn > tau).mean((-2, -1)), values) for tau in taus]
        profiles[name] = _columns(points)
    return profiles


def iqm_curves(curves: Mapping[str, Floats], *, reps: int = 2000) -> dict[str, tuple[Floats, Floats, Floats]]:
    """Of curves [R, K, P] the interquartile mean [P] at every point, and its low [P] and high [P] at each alone.

    The same runs are drawn at all points.
    """
    found = {}
    for name, curve in _checked(curves, n_axes=3).items():
        points = [curve[..., point] for point in range(curve.shape[2])]
        found[name] = _columns([_estimate(_iqm(point), _iqm(_drawn(point, reps)), point) for point in points])
    return found


def rank_distribution(scores: Scores, *, reps: int = 2000) -> dict[str, Floats]:
    """Of every algorithm how probable rank 1, 2 .. A is [A], by the mean of its runs on a level; mean over levels.

    Algorithms with equally many runs are taken to share their seeds, so the same are drawn for all of them. Equals
    share the ranks that they hold. All are nan if there is an algorithm of a single run.
    """
    checked = _checked(scores)
    n = len(checked)
    if any(len(values) == 1 for values in checked.values()):
        return {name: np.full(n, np.nan) for name in checked}
    means = np.round([_drawn(values, reps).mean(axis=1) for values in checked.values()], DECIMALS)  # [A, reps, K]
    distribution = {}
    for name, own in zip(checked, means, strict=True):
        better, equal = (means > own).sum(axis=0), (means == own).sum(axis=0)  # [reps, K]; its own equal
        shares = [((better <= rank) & (rank < better + equal)) / equal for rank in range(n)]
        distribution[name] = np.mean(shares, axis=(1, 2))
    return distribution


def paired_test(x: Floats, y: Floats, *, permutations: int = 10_000) -> PairedTest:
    """Whether x [R, K] and y [R, K], of the same seeds, differ in the mean: sign flips of their differences.

    "The Design of Experiments", Fisher (1935). If x and y do not differ, each difference is as probable with the other
    sign. Flips are all that there are, if these are no more than `permutations`; else so many are drawn, and p is
    (b + 1) / (n + 1) (Phipson & Smyth 2010). For p, runs of a seed on several levels are taken to be independent; the
    interval does not, as it draws whole seeds.

    Raises:
        ValueError: they are not of the same seeds and levels, or no scores.
    """
    checked = _checked({"x": x, "y": y})
    if len(x) != len(y):
        raise ValueError(f"x has {len(x)} runs, y {len(y)}: a paired test needs those of the same seeds")
    differences = checked["x"] - checked["y"]
    seeds = differences.mean(axis=1)
    drawn = _generator(len(seeds), "seeds").integers(len(seeds), size=(RESAMPLES, len(seeds)))
    p = _sign_flip_p(differences.ravel(), permutations)
    return PairedTest(*_estimate(seeds.mean(), seeds[drawn].mean(axis=1), differences), p)


def _aggregates(values: Floats, optimal: float, reps: int) -> dict[str, Estimate]:
    drawn = _drawn(values, reps)

    def gap(scores: Floats) -> Floats:
        return np.asarray(optimal - np.minimum(scores, optimal).mean(axis=(-2, -1)))

    statistics = {"mean": _mean, "median": _median, "iqm": _iqm, "optimality_gap": gap}
    return {name: _estimate(statistic(values), statistic(drawn), values) for name, statistic in statistics.items()}


def _mean(scores: Floats) -> Floats:  # [..., R, K] -> [...], as all three
    return np.asarray(scores.mean(axis=(-2, -1)))


def _median(scores: Floats) -> Floats:
    return np.asarray(np.median(scores.mean(axis=-2), axis=-1))


def _iqm(scores: Floats) -> Floats:
    n = scores.shape[-2] * scores.shape[-1]
    ascending = np.sort(scores.reshape(*scores.shape[:-2], n), axis=-1)
    return np.asarray(ascending[..., n // 4 : n - n // 4].mean(axis=-1))


def _improvement(x: Floats, y: Floats, reps: int) -> Estimate:
    wins = (x[:, None] > y) + 0.5 * (x[:, None] == y)  # [R of x, R of y, K]
    of_x, of_y = _rows(x, reps)[:, :, None], _rows(y, reps, "opponents")[:, None]
    drawn = wins[of_x, of_y, np.arange(wins.shape[2])].mean(axis=(1, 2, 3))
    return _estimate(wins.mean(), drawn, x if len(x) < len(y) else y)


def _sign_flip_p(differences: Floats, permutations: int) -> float:
    """The two-sided p of the sum of differences [n]."""
    n = len(differences)
    is_exact = n < permutations.bit_length()  # 2^n of them are no more
    if is_exact:
        flipped = np.arange(2**n)[:, None] >> np.arange(n) & 1
    else:
        flipped = _generator(n, "signs").integers(2, size=(permutations, n))
    sums = ((1 - 2 * flipped) * differences).sum(axis=1)
    as_far = int((np.abs(sums) >= abs(differences.sum()) - CLOSE).sum())
    return as_far / 2**n if is_exact else (as_far + 1) / (permutations + 1)


def _generator(n_runs: int, purpose: str) -> Generator:
    return Generator(Philox(key=stream_key(0, n_runs, f"bootstrap of {purpose}")))


def _rows(values: Floats, reps: int, purpose: str = "runs") -> NDArray[np.int64]:
    """Which runs are drawn on each level [reps, R, K]."""
    return _generator(len(values), purpose).integers(len(values), size=(reps, *values.shape))


def _drawn(values: Floats, reps: int) -> Floats:
    """Scores that are drawn from [R, K], on each level from its own: [reps, R, K]."""
    return np.asarray(values[_rows(values, reps), np.arange(values.shape[1])])


def _estimate(value: float | Floats, drawn: Floats, values: Floats) -> Estimate:
    """A figure with the interval that those [reps] of drawn samples of values [R, K] give."""
    if len(values) == 1:
        return Estimate(float(value), np.nan, np.nan)
    low, high = np.quantile(drawn, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return Estimate(float(value), float(low), float(high))


def _columns(points: list[Estimate]) -> tuple[Floats, Floats, Floats]:
    value, low, high = np.array(points, np.float64).reshape(-1, 3).T
    return value, low, high


def _checked(scores: Mapping[str, Floats], n_axes: int = 2) -> dict[str, Floats]:
    shape = "[runs, levels]" if n_axes == 2 else "[runs, levels, points]"
    checked = {name: np.asarray(values, np.float64) for name, values in scores.items()}
    for name, values in checked.items():
        first, others = next(iter(checked.items()))
        if values.ndim != n_axes or values.size == 0:
            raise ValueError(f"{name}: scores of shape {values.shape}: give {shape}, one at least of each")
        if values.shape[1:] != others.shape[1:]:
            raise ValueError(f"{name}: scores of shape {values.shape}, {first} of {others.shape}: give the same levels")
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: a score is not finite: leave out runs that lack one")
    return checked
