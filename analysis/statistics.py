"""What a sample of returns says of its mean."""

import numpy as np
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from railctl.common.seeding import stream_key

RESAMPLES = 1000  # as many as the study's own intervals
SHARE = 0.95


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """The 95% interval of the mean of values [K]: percentiles of the means of as large samples drawn from them.

    "An Introduction to the Bootstrap", Efron & Tibshirani (1993). Returns are bounded and lie in heaps (all arrived, or
    a deadlock), which Student's t would take for a bell. Equal values have equal intervals: the draws are keyed.
    """
    draws = Generator(Philox(key=stream_key(0, len(values), "bootstrap")))
    means = [values[draws.integers(len(values), size=len(values))].mean() for _ in range(RESAMPLES)]
    low, high = np.quantile(means, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return float(low), float(high)
