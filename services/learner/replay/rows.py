"""Rows of numbers, most of them zero, in a ring: only what is not zero is kept, bit for bit.

Four fifths of an observation are padding, which is normalised to +0.0. A row is its other values and where they stand,
in an arena that is itself a ring, since rows leave in the order in which they came; it grows when they do not fit. Any
row is kept exactly: -0.0 and NaN are values like others, and a row without a zero only takes more room.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel

PARTS = ("lengths", "positions", "values")  # of a state


class RowRing:
    """At most `capacity` rows [F] of float32. Rows are numbered as they come; row i lies at place i % capacity."""

    def __init__(self, capacity: int, n_features: int) -> None:
        self._capacity = capacity
        self._n_features = n_features
        self._narrow = np.min_scalar_type(n_features)  # uint8 for the study's 252
        self._starts = np.empty(capacity, np.int64)  # in the arena
        self._lengths = np.empty(capacity, self._narrow)
        self._arena = self._new_arena(0)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in (self._starts, self._lengths, *self._arena))

    def add(self, rows: NDArray[np.float32], first: int) -> None:
        """Add rows [M, F], M at most the capacity, the first of them being the `first`-th ever."""
        if rows.ndim != 2 or rows.shape[1] != self._n_features:
            raise ValueError(f"rows of {self._n_features} values are kept here, not an array {rows.shape}")
        bits = np.require(rows, np.float32, ("C", "A", "W")).view(np.uint32)
        done = 0
        while True:
            done += put(bits[done:], first + done, self._starts, self._lengths, *self._arena)
            if done == len(bits):
                return
            self._grow(first + done)

    def gather(self, places: NDArray[np.int64], out: NDArray[np.uint32]) -> None:
        """Write the rows at `places` [B] into `out` [B, F], the bits of float32; a place -1 gives a row of zeros."""
        expand(places, self._starts, self._lengths, *self._arena, out)

    def state(self, size: int) -> dict[str, NDArray[Any]]:
        """The rows at places 0..size-1 without the gaps between them: `PARTS`."""
        lengths = self._lengths[:size].copy()
        values, positions = self._new_arena(int(lengths.sum(dtype=np.int64)))
        relay(np.arange(size), self._starts.copy(), lengths, *self._arena, values, positions)
        return {"lengths": lengths, "positions": positions, "values": values}

    def checked(self, state: Mapping[str, NDArray[Any]], size: int) -> dict[str, NDArray[Any]]:
        """A copy of a `state` of `size` rows.

        Raises:
            ValueError: naming the part that does not fit.
        """
        wanted = size
        for part in PARTS:
            dtype, got = np.dtype(np.uint32) if part == "values" else self._narrow, state[part]
            if got.dtype != dtype or got.shape != (wanted,):
                raise ValueError(f"{part} is {got.dtype}{got.shape}, not {dtype}({wanted},)")
            if part == "lengths":
                wanted = int(got.sum(dtype=np.int64))
        if (state["lengths"] > self._n_features).any():
            raise ValueError(f"lengths has a row of more than {self._n_features} values")
        if (state["positions"] >= self._n_features).any():
            raise ValueError(f"positions has one beyond {self._n_features} features")
        return {part: state[part].copy() for part in PARTS}

    def restore(self, state: Mapping[str, NDArray[Any]], oldest: int) -> None:
        """Take on a `checked` state, whose rows are the newest ever; the oldest is at place `oldest`."""
        size = len(state["lengths"])
        self._lengths[:size] = state["lengths"]
        self._starts[:size] = np.cumsum(state["lengths"], dtype=np.int64) - state["lengths"]
        self._arena = self._new_arena(len(state["values"]))
        order = (oldest + np.arange(size)) % max(size, 1)
        relay(order, self._starts, self._lengths, state["values"], state["positions"], *self._arena)

    def _grow(self, number: int) -> None:
        """Make the arena larger before row `number` comes, so that this row fits."""
        order = np.arange(max(0, number - self._capacity + 1), number) % self._capacity
        live = int(self._lengths[order].sum(dtype=np.int64))
        old, self._arena = self._arena, self._new_arena(live + live // 4 + self._n_features)
        relay(order, self._starts, self._lengths, *old, *self._arena)

    def _new_arena(self, size: int) -> tuple[NDArray[np.uint32], NDArray[Any]]:
        """Values and their positions. Not zeros: the kernel gives pages to this memory only as it fills."""
        return np.empty(size, np.uint32), np.empty(size, self._narrow)


@bare_kernel
def put(
    rows: NDArray[np.uint32],
    first: int,
    starts: NDArray[np.int64],
    lengths: NDArray[Any],
    values: NDArray[np.uint32],
    positions: NDArray[Any],
) -> int:
    """Add rows [M, F] until one does not fit; returns how many did.

    The live rows lie from `head`, where the oldest starts, to `tail`, where the newest ends, perhaps around the end of
    the arena, but never across it: a row that does not fit before the end starts at 0. The tail stops short of the
    head, so that the two meet only where nothing is kept.
    """
    capacity, size = len(starts), len(values)
    for row in range(len(rows)):
        number = first + row
        oldest = max(0, number - capacity + 1)  # who lies where this row goes has gone
        head = tail = 0
        if oldest < number:
            head = starts[oldest % capacity]
            newest = (number - 1) % capacity
            tail = starts[newest] + np.int64(lengths[newest])
        length = 0
        for value in rows[row]:
            length += value != 0
        around = tail >= head and tail + length > size
        start = 0 if around else tail
        limit = head if around or tail < head else size + 1
        if start + length >= limit:
            return row
        place = number % capacity
        starts[place], lengths[place] = start, length
        for position in range(rows.shape[1]):
            if rows[row, position] != 0:
                values[start], positions[start] = rows[row, position], position
                start += 1
    return len(rows)


@bare_kernel
def expand(
    places: NDArray[np.int64],
    starts: NDArray[np.int64],
    lengths: NDArray[Any],
    values: NDArray[np.uint32],
    positions: NDArray[Any],
    out: NDArray[np.uint32],
) -> None:
    """Write the rows at `places` [B] into `out` [B, F]; see `RowRing.gather`."""
    for row in range(len(places)):
        out[row, :] = 0
        place = places[row]
        if place >= 0:
            start = starts[place]
            for cell in range(start, start + np.int64(lengths[place])):
                out[row, positions[cell]] = values[cell]


@bare_kernel
def relay(
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    lengths: NDArray[Any],
    values: NDArray[np.uint32],
    positions: NDArray[Any],
    new_values: NDArray[np.uint32],
    new_positions: NDArray[Any],
) -> None:
    """Lay the rows at places `order` into a new arena, one behind the other; `starts` follows."""
    end = 0
    for place in order:
        start, length = starts[place], np.int64(lengths[place])
        for cell in range(length):
            new_values[end + cell], new_positions[end + cell] = values[start + cell], positions[start + cell]
        starts[place] = end
        end += length
