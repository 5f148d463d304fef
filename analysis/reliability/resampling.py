"""Mean ranks of resampled runs: bootstraps for intervals, permutations for p-values.

"An Introduction to the Bootstrap", Efron & Tibshirani (1993), as Chan et al. (2020) apply it. Metrics of single runs
are computed once and their values resampled. Those over all runs are computed anew for every sample of curves. Sums of
ranks are multiples of a half, so they are exact in whatever order they are taken.
"""

from collections.abc import Callable, Iterator
from itertools import combinations

import numpy as np

from railctl.analysis.reliability.curves import Floats, Ints
from railctl.analysis.reliability.draws import Draws, first_halves
from railctl.analysis.reliability.ranks import own_ranks, pooled_ranks, rank_among

CHUNK = 500  # samples of curves at a time, which bounds memory

Spread = Callable[[Floats, Floats | None], Floats]  # curves [..., R, P] and their ranges [..., R] to values [..., P]


def pairs_of(algorithms: int) -> list[tuple[int, int]]:
    """All pairs, the first of them with the smaller index."""
    return list(combinations(range(algorithms), 2))


def bootstrapped_runs(worse: Floats, draws: Draws) -> Floats:
    """Mean rank of each algorithm [A, n] if its own runs alone are drawn anew: from penalties [A, K, R].

    A run's rank is its rank among its own algorithm's runs plus its place among the others'. The first add up to the
    same whatever is drawn, the second stay with the run.
    """
    _, levels, runs = worse.shape
    places = pooled_ranks(worse) - own_ranks(worse)
    chosen = places[:, np.arange(levels)[:, None], draws.choices(levels)]  # [A, n, K, R]
    total = levels * runs * (runs + 1) / 2
    return np.asarray((chosen.sum((2, 3)) + total) / (levels * runs))


def permuted_runs(worse: Floats, draws: Draws) -> Floats:
    """Differences of mean rank [pairs, n], second minus first, when the ranks of a pair are dealt out anew."""
    algorithms, levels, runs = worse.shape
    ranks = pooled_ranks(worse)
    both = np.array(
        [np.concatenate([ranks[one], ranks[two]], axis=-1).ravel() for one, two in pairs_of(algorithms)]
    ).reshape(-1, levels * 2 * runs)
    first = both @ first_halves(draws, levels).T
    second = both.sum(1, keepdims=True) - first
    return np.asarray(second / (levels * runs) - first / (levels * runs))


def bootstrapped_curves(points: Floats, ranges: Floats | None, spread: Spread, choices: Ints) -> Floats:
    """Values of drawn curves [n, A, K, P]: from points [A, K, R, P], what they are divided by [A, K, R], draws [n, R].

    As in the original, every level meets the same draws: a run is drawn with its curves on all levels.
    """
    parts = []
    for chosen in _chunks(choices):
        drawn = points[:, :, chosen]  # [A, K, n, R, P]
        values = spread(drawn, None if ranges is None else ranges[:, :, chosen])
        parts.append(np.moveaxis(values, 2, 0))
    return np.concatenate(parts)


def permuted_curves(points: Floats, ranges: Floats | None, spread: Spread, shuffles: Ints) -> Floats:
    """Values of two algorithms [n, 2, K, P] whose curves [2, K, R, P] are dealt out anew, in orders [n, 2R]."""
    _, levels, runs, n_points = points.shape
    both = points.swapaxes(0, 1).reshape(levels, 2 * runs, n_points)
    theirs = None if ranges is None else ranges.swapaxes(0, 1).reshape(levels, 2 * runs)
    parts = []
    for shuffle in _chunks(shuffles):
        dealt = shuffle.reshape(-1, 2, runs)
        values = spread(both[:, dealt], None if theirs is None else theirs[:, dealt])  # [K, n, 2, P]
        parts.append(np.moveaxis(values, 0, 2))
    return np.concatenate(parts)


def bootstrapped_rank(worse: Floats, samples: Floats) -> Floats:
    """Mean rank of each algorithm [A, n] if its penalty alone is a sample: of penalties [A, K], samples [n, A, K]."""
    return np.array(
        [
            rank_among(samples[:, algorithm], np.delete(worse, algorithm, axis=0)).mean(1)
            for algorithm in range(len(worse))
        ]
    )


def permuted_difference(worse: Floats, pair: tuple[int, int], samples: Floats) -> Floats:
    """Differences of mean rank [n] when a pair's penalties are samples [n, 2, K]; the others' [A, K] stay."""
    others = np.delete(worse, pair, axis=0)
    first, second = samples[:, 0], samples[:, 1]
    unknown = np.isnan(first) | np.isnan(second)
    ranks = [
        np.where(unknown, np.nan, rank_among(one, others) + (other < one) + (other == one) / 2).mean(1)
        for one, other in ((first, second), (second, first))
    ]
    return np.asarray(ranks[1] - ranks[0])


def _chunks(samples: Ints) -> Iterator[Ints]:
    return (samples[start : start + CHUNK] for start in range(0, len(samples), CHUNK))
