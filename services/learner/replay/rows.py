# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Rows of numbers, most of them zero, in a ring: only what is not zero is kept, bit for bit.

Nine tenths of an observation are +0.0, padding above all. A row is kept as the number n of its other values, these, and
where they stand, in an arena of 32-bit words that is itself a ring, since items leave in the order in which they came;
it grows when they do not fit. Any row is kept exactly: -0.0 and NaN are values like others, and a row without a zero
only takes more room.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.services.learner.replay.prefetch import prefetch

WORDS_PER_LINE = 16  # of the cache
LINES = 4  # that two rows of an observation lie in
AHEAD = 8  # items between the one that is asked for and the one that is written

Words = NDArray[np.uint32]
Rows = NDArray[np.uint32]  # [B, R, F]: the bits of float32
Arrays = tuple[NDArray[np.int64], Words, NDArray[Any]]
RowsOut = tuple[NDArray[np.int64], NDArray[np.int64], Words]  # where rows start, columns and values: see `unfold`


class RowRing:
    """At most `capacity` items of `n_rows` rows [F]. Items are numbered as they come; i lies at place i % capacity.

    Attributes:
        arrays: what compiled code needs to `unfold` rows: where items start, and the arena, as words and as positions;
            the same until the next item is added.
    """

    def __init__(self, capacity: int, n_rows: int, n_features: int) -> None:
        self._capacity = capacity
        self._n_rows = n_rows
        self._n_features = n_features
        self._position: np.dtype[Any] = np.min_scalar_type(n_features)  # uint8 for the study's 252
        self._largest = n_rows * int(room(n_features, self._position.itemsize))  # words of an item without a zero
        self._starts = np.empty(capacity, np.int64)  # where in the arena an item starts
        self._ends = np.empty(capacity, np.int64)  # and what follows it
        self._set_arena(np.empty(0, np.uint32))

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return self._starts.nbytes + self._ends.nbytes + self._words.nbytes

    def add(self, rows: Rows, first: int, since: int = 0) -> None:
        """Add M items, at most the capacity, numbered from `first` on; of those before, all below `since` are gone."""
        if rows.shape[1:] != (self._n_rows, self._n_features):
            raise ValueError(f"{self._n_rows} rows have {self._n_features} values each here, not {rows.shape[1:]}")
        done = put(rows, 0, first, since, self._ends, *self.arrays)
        while done < len(rows):
            self._grow(first + done, since)
            done += put(rows, done, first + done, since, self._ends, *self.arrays)

    def gather(self, places: NDArray[np.int64], out: RowsOut) -> None:
        """Write the first rows of the items at `places` [B] into `out`, see `unfold`; place -1 gives zeros."""
        unfold(places, *self.arrays, *out)

    def room_for(self, count: int, n_rows: int) -> RowsOut:
        """Memory for the first `n_rows` rows of so many items."""
        size = count * self._n_features
        columns, values = np.empty((n_rows, size), np.int64), np.empty((n_rows, size), np.uint32)
        return np.zeros((n_rows, count + 1), np.int64), columns, values

    def state(self, size: int) -> Words:
        """The items at places 0..size-1, one behind the other."""
        starts, ends = self._starts[:size].copy(), self._ends[:size].copy()
        words = np.empty(int((ends - starts).sum()), np.uint32)
        relay(np.arange(size), starts, ends, self._words, words)
        return words

    def located(self, words: Words, size: int) -> NDArray[np.int64]:
        """Where the `size` items of a `state` end, one behind the other.

        Raises:
            ValueError: they are not so many items of such rows.
        """
        ends = np.empty(size, np.int64)
        if not locate(words, words.view(self._position), self._n_rows, self._n_features, ends):
            raise ValueError(
                f"replay: rows: {len(words)} words are not {size} times {self._n_rows} rows of {self._n_features}"
            )
        return ends

    def restore(self, words: Words, ends: NDArray[np.int64], oldest: int) -> None:
        """Take on a `state` as the newest items ever; the oldest of them lies at place `oldest`."""
        size = len(ends)
        self._starts[:size] = np.concatenate(([0], ends))[:size]
        self._ends[:size] = ends
        self._set_arena(np.empty_like(words))
        relay((oldest + np.arange(size)) % max(size, 1), self._starts, self._ends, words, self._words)

    def _set_arena(self, words: Words) -> None:
        """Keep rows in this memory from now on."""
        self._words = words
        self.arrays: Arrays = self._starts, words, words.view(self._position)

    def _grow(self, number: int, since: int) -> None:
        """Make the arena larger before item `number` comes, so that it fits."""
        order = np.arange(max(since, number - self._capacity + 1), number) % self._capacity
        live = int((self._ends[order] - self._starts[order]).sum())
        # Not zeros: the kernel gives pages to this memory only as it fills.
        words = np.empty(live + live // 4 + self._largest + 1, np.uint32)
        relay(order, self._starts, self._ends, self._words, words)
        self._set_arena(words)


@bare_kernel
def room(length: int, width: int) -> int:
    """Words of a row of so many values that are not zero, with positions of `width` bytes."""
    return 1 + length + (length * width + 3) // 4


@bare_kernel
def put(
    rows: Rows,
    begin: int,
    first: int,
    since: int,
    ends: NDArray[np.int64],
    starts: NDArray[np.int64],
    words: Words,
    positions: NDArray[Any],
) -> int:
    """Add items from `begin` on until one does not fit; returns how many did.

    The live items lie from `head`, where the oldest starts, to `tail`, where the newest ends, perhaps around the end of
    the arena, but never across it: an item that does not fit before the end starts at 0. The tail stops short of the
    head, so that the two meet only where nothing is kept.
    """
    capacity, size, width = len(ends), len(words), positions.itemsize
    n_rows = rows.shape[1]
    for item in range(begin, len(rows)):
        number = first + item - begin
        oldest = max(since, number - capacity + 1)  # who lies where this item goes has gone
        head = tail = 0
        if oldest < number:
            head, tail = starts[oldest % capacity], ends[(number - 1) % capacity]
        needed = 0
        for row in range(n_rows):
            needed += room(count(rows[item, row]), width)
        around = tail >= head and tail + needed > size
        start = 0 if around else tail
        limit = head if around or tail < head else size + 1
        if start + needed >= limit:
            return item - begin
        starts[number % capacity] = start
        for row in range(n_rows):
            start = squeeze(rows[item, row], start, words, positions)
        ends[number % capacity] = start
    return len(rows) - begin


@bare_kernel
def count(row: Words) -> int:
    """How many values are not zero; without a branch, so that the processor does many at a time."""
    length = 0
    for value in row:
        length += value != 0
    return length


@bare_kernel
def squeeze(row: Words, start: int, words: Words, positions: NDArray[Any]) -> int:
    """Write a row [F] from word `start` on; returns where it ends."""
    length = count(row)
    end = start + room(length, positions.itemsize)
    words[end - 1] = 0  # or what is left of the last word would be anything
    words[start] = length
    word = start + 1
    cell = (word + length) * (4 // positions.itemsize)
    for position in range(len(row)):
        if row[position] != 0:
            words[word], positions[cell] = row[position], position
            word += 1
            cell += 1
    return end


@bare_kernel
def fetch(place: int, starts: NDArray[np.int64], words: Words) -> None:
    """Have the item at `place` brought nearer."""
    for line in range(LINES):
        prefetch(words, starts[max(place, 0)] + line * WORDS_PER_LINE)


@bare_kernel
def unfold(
    places: NDArray[np.int64],
    starts: NDArray[np.int64],
    words: Words,
    positions: NDArray[Any],
    out_starts: NDArray[np.int64],
    out_columns: NDArray[np.int64],
    out_values: Words,
) -> None:
    """Write down what is not zero in the rows at `places` [B], see `services.learner.sparse`; place -1 has nothing.

    Args:
        places: [B].
        starts: as `RowRing.arrays` has it.
        words: as `RowRing.arrays` has it.
        positions: as `RowRing.arrays` has it.
        out_starts: [R, B + 1], overwritten, for the first R rows of an item.
        out_columns: [R, at least all], overwritten.
        out_values: [R, at least all], overwritten.
    """
    for place in places:
        fetch(place, starts, words)  # all at once, before any is waited for
    per_word = 4 // positions.itemsize
    out_starts[:, 0] = 0
    for item in range(len(places)):
        if item + AHEAD < len(places):
            fetch(places[item + AHEAD], starts, words)  # what is written may have pushed it out of the nearest cache
        start = starts[max(places[item], 0)]
        for number in range(len(out_starts)):
            columns, values, at = out_columns[number], out_values[number], out_starts[number, item]
            length = int(np.int64(words[start])) if places[item] >= 0 else 0
            cell = (start + 1 + length) * per_word
            for value in range(length):
                columns[at + value], values[at + value] = positions[cell + value], words[start + 1 + value]
            out_starts[number, item + 1] = at + length
            start += room(length, positions.itemsize)


@bare_kernel
def relay(
    order: NDArray[np.int64], starts: NDArray[np.int64], ends: NDArray[np.int64], words: Words, new_words: Words
) -> None:
    """Lay the items at places `order` into a new arena, one behind the other; `starts` and `ends` follow."""
    end = 0
    for place in order:
        start, length = starts[place], ends[place] - starts[place]
        for word in range(length):
            new_words[end + word] = words[start + word]
        starts[place], ends[place] = end, end + length
        end += length


@bare_kernel
def locate(words: Words, positions: NDArray[Any], n_rows: int, n_features: int, ends: NDArray[np.int64]) -> bool:
    """Fill `ends` with where each item ends; whether all words are used and every position exists."""
    start, per_word = 0, 4 // positions.itemsize
    for item in range(len(ends)):
        for _ in range(n_rows):
            if start >= len(words) or words[start] > n_features:
                return False
            length = int(np.int64(words[start]))
            cell = (start + 1 + length) * per_word
            start += room(length, positions.itemsize)
            if start > len(words):
                return False
            for value in range(length):
                if positions[cell + value] >= n_features:
                    return False
        ends[item] = start
    return start == len(words)
