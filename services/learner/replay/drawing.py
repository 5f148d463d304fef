# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""A batch out of a replay in one call: where its items lie, their importance weights, their numbers and rows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.services.learner.replay.philox import draw_below, draw_uniform
from railctl.services.learner.replay.prefetch import prefetch
from railctl.services.learner.replay.priorities import find, weigh
from railctl.services.learner.replay.rows import Words, unfold


@bare_kernel
def draw(
    key: np.uint64,
    count: int,
    places: NDArray[np.int64],
    numbers: Words,
    integers: NDArray[np.int64],
    floats: Words,
    starts: NDArray[np.int64],
    words: Words,
    positions: NDArray[Any],
    row_starts: NDArray[np.int64],
    row_columns: NDArray[np.int64],
    row_values: Words,
) -> None:
    """Draw `places` [B] below `count` with a key's stream; then as `gather`."""
    draw_below(key, count, places)
    gather(places, numbers, integers, floats, starts, words, positions, row_starts, row_columns, row_values)


@bare_kernel
def draw_by_priority(
    key: np.uint64,
    tree: NDArray[np.float64],
    draws: NDArray[np.float64],
    beta: float,
    weights: NDArray[np.float32],
    places: NDArray[np.int64],
    numbers: Words,
    integers: NDArray[np.int64],
    floats: Words,
    starts: NDArray[np.int64],
    words: Words,
    positions: NDArray[Any],
    row_starts: NDArray[np.int64],
    row_columns: NDArray[np.int64],
    row_values: Words,
) -> None:
    """Find `places` [B] and `weights` [B] by priority, `draws` [B] being overwritten; then as `gather`."""
    draw_uniform(key, draws)
    find(tree, draws, places)
    n_numbers = len(integers) + len(floats)
    for place in places:
        prefetch(numbers, place * n_numbers)
    weigh(tree, places, beta, draws, weights)
    gather(places, numbers, integers, floats, starts, words, positions, row_starts, row_columns, row_values)


@bare_kernel
def gather(
    places: NDArray[np.int64],
    numbers: Words,
    integers: NDArray[np.int64],
    floats: Words,
    starts: NDArray[np.int64],
    words: Words,
    positions: NDArray[Any],
    row_starts: NDArray[np.int64],
    row_columns: NDArray[np.int64],
    row_values: Words,
) -> None:
    """Write the items at `places` [B] out.

    Args:
        places: [B].
        numbers: [capacity * (I + J)], an item's integers, then its floats, as 32 bits each.
        integers: [I, at least B], overwritten.
        floats: [J, at least B], overwritten.
        starts: as `RowRing.arrays` has it.
        words: as `RowRing.arrays` has it.
        positions: as `RowRing.arrays` has it.
        row_starts: as `unfold` has it, with the next two.
        row_columns: overwritten.
        row_values: overwritten.
    """
    n_integers, n_floats = len(integers), len(floats)
    for item in range(len(places)):
        first = places[item] * (n_integers + n_floats)
        for column in range(n_integers):
            integers[column, item] = np.int32(numbers[first + column])
        for column in range(n_floats):
            floats[column, item] = numbers[first + n_integers + column]
    unfold(places, starts, words, positions, row_starts, row_columns, row_values)


@bare_kernel
def lay_down(new: Words, first: int, capacity: int, numbers: Words) -> None:
    """Write the numbers of `new` items [M, I + J], the first of which is number `first`, to their places."""
    width = new.shape[1]
    for item in range(len(new)):
        at = (first + item) % capacity * width
        for column in range(width):
            numbers[at + column] = new[item, column]
