"""What a sample of returns says of its mean."""

from math import sqrt

import numpy as np
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from railctl.common.seeding import stream_key

RESAMPLES = 1000  # as many as the study's own intervals
SHARE = 0.95
NORMAL_QUANTILE = 1.959964  # of (1 + SHARE) / 2


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """The 95% interval of the mean of values [K]: percentiles of the means of as large samples drawn from them.

    "An Introduction to the Bootstrap", Efron & Tibshirani (1993). Returns are bounded and lie in heaps (all arrived, or
    a deadlock), which Student's t would take for a bell. Equal values have equal intervals: the draws are keyed.
    """
    draws = Generator(Philox(key=stream_key(0, len(values), "bootstrap")))
    means = [values[draws.integers(len(values), size=len(values))].mean() for _ in range(RESAMPLES)]
    low, high = np.quantile(means, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return float(low), float(high)


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """The 95% interval of a share of independent trials: E. B. Wilson (1927), which also holds near 0 and 1.

    >>> low, high = wilson_interval(48, 50)
    >>> round(low, 3), round(high, 3)
    (0.865, 0.989)
    """
    share, square = successes / trials, NORMAL_QUANTILE**2
    middle = (share + square / (2 * trials)) / (1 + square / trials)
    half = NORMAL_QUANTILE / (1 + square / trials) * sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    return max(0.0, middle - half), min(1.0, middle + half)
