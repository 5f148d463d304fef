"""Ranks of values within a level; 1 is the best, and equal values share the mean of their places."""

import numpy as np
from scipy.stats import rankdata

from railctl.analysis.reliability.curves import Floats

DECIMALS = 10  # values that agree in as many are equal


def penalties(values: Floats, *, bigger_is_better: bool) -> Floats:
    """The values as something of which less is better, without their rounding errors; same shape."""
    return np.asarray(np.round(-values if bigger_is_better else values, DECIMALS))


def pooled_ranks(worse: Floats) -> Floats:
    """Rank within each level over all else: penalties [A, K, ...] to ranks of the same shape."""
    by_level = np.moveaxis(worse, 1, 0)
    ranks = rankdata(by_level.reshape(len(by_level), -1), axis=1)
    return np.asarray(np.moveaxis(ranks.reshape(by_level.shape), 0, 1))


def own_ranks(worse: Floats) -> Floats:
    """Rank of every run among those of its own algorithm and level, [A, K, R]."""
    return np.asarray(rankdata(worse, axis=2))


def rank_among(worse: Floats, others: Floats) -> Floats:
    """Rank of each one [..., K] beside others [M, K] of its level; of nan it is nan."""
    ranks = 1 + sum(((other < worse) + (other == worse) / 2 for other in others), start=np.zeros(worse.shape))
    return np.asarray(np.where(np.isnan(worse), np.nan, ranks))


def mean_ranks(worse: Floats) -> Floats:
    """Mean rank of each algorithm [A]: of penalties [A, K, R], or [A, K] where a metric is over all runs.

    If anything is not finite, no rank is known and all are nan.
    """
    if not np.isfinite(worse).all():
        return np.full(len(worse), np.nan)
    return np.asarray(pooled_ranks(worse).reshape(len(worse), -1).mean(1))


def runs_ranked(worse: Floats) -> int:
    """What mean ranks are divided by, so that they are about 1 to A: the values of an algorithm and level."""
    return worse.shape[2] if worse.ndim == 3 else 1
