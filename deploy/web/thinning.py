"""Long columns of numbers made short enough to draw, so that nothing of what matters in them gets lost. Pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

POINTS = 240  # of a curve; more than a screen shows apart
FEWEST = 5  # numbers that make a quartile
DIGITS = 4  # after the point, of what is drawn

Numbers = NDArray[np.float32]


def moving(values: Numbers, window: int) -> list[tuple[int, float, float, float, float]]:
    """What the last `window` values are like, at no more than POINTS places.

    Args:
        values: [N].
        window: it is longer where points lie further apart, so that every value counts somewhere; shorter at the start.

    Returns:
        Of each point, how many values there were up to it; median, lower and upper quartile, mean.
    """
    count = len(values)
    if count < FEWEST:
        return []
    window = max(window, -(-count // POINTS))
    ends = np.unique(np.linspace(FEWEST, count, min(POINTS, count - FEWEST + 1)).astype(int))
    growing, full = ends[ends < window], ends[ends >= window]
    parts = [_described(values[None, :end]) for end in growing]
    if len(full):
        parts.append(_described(np.lib.stride_tricks.sliding_window_view(values, window)[full - window]))
    low, middle, high, mean = np.concatenate(parts, axis=1).round(DIGITS).tolist()
    return list(zip(ends.tolist(), middle, low, high, mean, strict=True))


def _described(windows: Numbers) -> NDArray[np.float64]:
    """Quartiles and mean of windows [P, W]; [4, P]."""
    quartiles = np.percentile(windows, (25, 50, 75), axis=1)
    return np.concatenate([quartiles, windows.mean(axis=1, dtype=np.float64)[None]])


def sample(places: Sequence[int], values: Numbers, most: int) -> tuple[list[tuple[int, float]], int]:
    """Every so manieth value with its place, at most `most` of them; and every how manieth that is."""
    every = max(1, -(-len(values) // most))
    return list(zip(places[::every], values[::every].astype(float).round(DIGITS).tolist(), strict=True)), every


def blocks(values: Numbers, size: int) -> list[float]:
    """The means of whole blocks; a rest that is not a whole one is left out."""
    whole = len(values) // size
    means: list[float] = values[: whole * size].reshape(whole, size).mean(axis=1).astype(float).round(DIGITS).tolist()
    return means


def block_size(total: int, most: int) -> int:
    """The least of 1, 2, 5, 10, 20, 50 ... with at most `most` blocks in `total`.

    >>> block_size(1500, 60), block_size(120, 60), block_size(10, 60)
    (50, 2, 1)
    """
    size, steps = 1, (2.0, 2.5, 2.0)
    for turn in range(60):
        if total <= size * most:
            break
        size = round(size * steps[turn % 3])
    return size
