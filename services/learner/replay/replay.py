"""Experience replay: a ring of the newest items (Lin 1992), drawn uniformly or by priority.

Uniform batches are drawn with replacement (Mnih et al. 2015 do not say): a draw costs the same however much the ring
holds. Prioritised ones are those of Schaul et al. 2016, see `priorities`. What an item is made of is up to the learner:
named numbers, and named rows [F], which are kept without their zeros, see `rows`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rules.replay import PrioritizedReplay, ReplayConfig
from railctl.services.learner.replay.drawing import draw, draw_by_priority, lay_down
from railctl.services.learner.replay.priorities import Priorities
from railctl.services.learner.replay.rows import RowRing, RowsOut
from railctl.services.learner.sparse import SparseRows

BACK = "back"  # the column that `histories` follows
ROWS = "rows"  # of a state
PRIORITIES = ("priorities", "priority_maximum")
NUMBERS = (np.uint8, np.int8, np.int16, np.int32, np.float32)  # what a column may be


class Items(NamedTuple):
    """M items as a replay takes them in.

    Attributes:
        numbers: [M, I + J], those of its columns that are integers as int32, then the floats, 32 bits each.
        rows: [M, R, F], the bits of float32.
    """

    numbers: NDArray[np.uint32]
    rows: NDArray[np.uint32]

    def part(self, begin: int, end: int) -> "Items":
        """Those from `begin` to `end`."""
        return Items(self.numbers[begin:end], self.rows[begin:end])


class Sample(NamedTuple):
    """B items in memory that is used again, valid until the next sample of the same replay.

    Attributes:
        columns: by name, [B] int64 or float32.
        rows: by name, [B, F].
        weights: [B] float32, the importance weights (1/(N P))^beta divided by the largest; ones if drawn uniformly.
        places: [B], where the items lie, for `reprioritise` and `histories`.
    """

    columns: dict[str, NDArray[Any]]
    rows: dict[str, SparseRows]
    weights: NDArray[np.float32]
    places: NDArray[np.int64]


class Replay:
    """A ring of at most `config.capacity` items; the oldest give way."""

    def __init__(
        self, config: ReplayConfig, columns: Mapping[str, DTypeLike], rows: Sequence[str], n_features: int
    ) -> None:
        """Items have a number for each of `columns`, of these dtypes, and `n_features` for each of `rows`.

        There is at least one of both.
        """
        self._config, self._capacity = config, config.capacity
        self._n_features = n_features
        self._dtypes = {name: np.dtype(dtype) for name, dtype in columns.items()}
        if wrong := {name: str(dtype) for name, dtype in self._dtypes.items() if dtype not in NUMBERS}:
            raise ValueError(f"columns are of {', '.join(dtype.__name__ for dtype in NUMBERS)}, not {wrong}")
        self._integers = tuple(name for name, dtype in self._dtypes.items() if dtype.kind in "iu")
        self._floats = tuple(name for name, dtype in self._dtypes.items() if dtype.kind == "f")
        # An item's numbers lie side by side. Not zeros: the kernel gives pages to this memory only as the ring fills.
        numbers = np.empty((config.capacity, len(columns)), np.uint32)
        self._numbers, self._columns = numbers.reshape(-1), self._views(numbers)
        self._row_names = tuple(rows)
        self._rows = RowRing(config.capacity, len(rows), n_features)
        self._priorities = Priorities(config.capacity, config.alpha) if isinstance(config, PrioritizedReplay) else None
        self._added = 0  # ever, or as many as would have left the ring as it is
        self._make_sample(0)
        self._histories = self._rows.room_for(0, 1)

    def __len__(self) -> int:
        return min(self._added, self._capacity)

    @property
    def nbytes(self) -> int:
        """Bytes of all that is kept, and of the room for more."""
        return self._numbers.nbytes + self._rows.nbytes + (self._priorities.nbytes if self._priorities else 0)

    def add(self, items: Mapping[str, NDArray[Any]], priorities: NDArray[np.float64] | None = None) -> None:
        """Append M items that are told by name; see `append`.

        Raises:
            ValueError: the arrays do not fit.
        """
        if set(items) != {*self._columns, *self._row_names}:
            raise ValueError(f"items need {sorted({*self._columns, *self._row_names})}, got {sorted(items)}")
        count = len(next(iter(items.values())))
        if any(len(array) != count for array in items.values()):
            raise ValueError(f"items differ in number: { ({name: len(items[name]) for name in items}) }")
        if any(items[name].shape[1:] != (self._n_features,) for name in self._row_names):
            shapes = [items[name].shape for name in self._row_names]
            raise ValueError(f"rows have {self._n_features} values here, not {shapes}")
        numbers = np.empty((count, len(self._columns)), np.uint32)
        for name, column in self._views(numbers).items():
            column[:] = items[name]
        rows = np.empty((count, len(self._row_names), self._n_features), np.float32)
        for number, name in enumerate(self._row_names):
            rows[:, number] = items[name]
        self.append(Items(numbers, rows.view(np.uint32)), priorities)

    def append(self, items: Items, priorities: NDArray[np.float64] | None = None) -> None:
        """Append M items, oldest first; without `priorities` they get the largest that there has been, 1 at first."""
        count, since = len(items.numbers), 0
        first, end = self._added, self._added + count
        if count > self._capacity:  # those before would be overwritten at once
            items = items.part(count - self._capacity, count)
            priorities = None if priorities is None else priorities[-self._capacity :]
            first = since = end - self._capacity
        if count == 0:
            return
        if self._priorities:
            self._priorities.put(np.arange(first, end) % self._capacity, priorities)
        self._rows.add(items.rows, first, since)
        lay_down(items.numbers, first, self._capacity, self._numbers)
        self._added = end

    def sample(self, size: int, key: int, beta: float = 1.0) -> Sample:
        """`size` items, with replacement.

        Args:
            size: B.
            key: of the stream of draws, those of numpy's `Generator(Philox(key=key))`; 64 bits.
            beta: the exponent of the importance weights.

        Raises:
            ValueError: the ring is empty.
        """
        if self._added == 0:
            raise ValueError("cannot sample from an empty replay: add something first")
        if len(self._sample.places) != size:
            self._make_sample(size)
        sample, stream = self._sample, np.uint64(key)
        items = sample.places, self._numbers, *self._numbers_out, *self._rows.arrays, *self._rows_out
        if self._priorities:
            draw_by_priority(stream, self._priorities.tree, self._draws, beta, sample.weights, *items)
        else:
            draw(stream, len(self), *items)
        return sample

    def reprioritise(self, places: NDArray[np.int64], priorities: NDArray[np.floating[Any]]) -> None:
        """Give the items at `places` [B] new priorities, at least 0; the last counts if there are several for one.

        Raises:
            ValueError: a priority is negative or not finite; then nothing has changed.
        """
        if self._priorities:
            self._priorities.put(places, priorities)

    def temper(self, progress: float) -> None:
        """Have priorities count as they do after a share of the run, which is more than before."""
        if self._priorities:
            self._priorities.temper(self._exponent(progress))

    def histories(self, places: NDArray[np.int64], length: int) -> SparseRows:
        """The last rows of the trains whose items lie at `places` [B], up to these items; of the first row column.

        Column `back` says how many items earlier the same train's previous item was added, 0 for none.

        Returns:
            [L, B, F], zeros in front where a history begins, or what came before has been overwritten; valid until the
            next call.
        """
        if self._histories[0].shape[1] != length * len(places) + 1:
            self._histories = self._rows.room_for(length * len(places), 1)
        chain = np.empty((length, len(places)), np.int64)
        trace_back(self._columns[BACK], self._oldest, self._capacity, places, chain)
        self._rows.gather(chain.reshape(-1), self._histories)
        return self._row(self._histories, 0, length, len(places))

    def metrics(self) -> dict[str, float]:
        """`replay_fill`, a share of the capacity; and `priority_mean` and `priority_max`, to the power of alpha."""
        metrics = {"replay_fill": len(self) / self._capacity}
        if self._priorities:
            metrics["priority_mean"] = self._priorities.total / max(1, len(self))
            metrics["priority_max"] = self._priorities.largest
        return metrics

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of all that the ring holds, in the order of its places, and its cursor."""
        size = len(self)
        state = {name: self._columns[name][:size].astype(dtype) for name, dtype in self._dtypes.items()}
        state[ROWS] = self._rows.state(size)
        if self._priorities:
            state |= self._priorities.state(size)
        return {**state, "cursor": np.array(self._added % self._capacity, np.int64)}

    def restore(self, state: Mapping[str, NDArray[Any]], progress: float = 0.0) -> None:
        """Take on a `state`: what is sampled and overwritten from here on is as in the ring that gave it.

        `progress` is what that ring was last tempered with.

        Raises:
            ValueError: naming the tensor that is missing, unknown, of another dtype or shape, or out of range; then
                nothing has changed.
        """
        known = {*self._columns, ROWS, "cursor", *(PRIORITIES if self._priorities else ())}
        if different := sorted(set(state) ^ known):
            raise ValueError(f"replay: tensor {different[0]} is {'unknown' if different[0] in state else 'missing'}")
        size, cursor = self._checked_size(state), int(state["cursor"])
        words = state[ROWS].copy()
        ends = self._rows.located(words, size)
        for name, column in self._columns.items():
            column[:size] = state[name]
        self._added = size if size < self._capacity else self._capacity + cursor
        self._rows.restore(words, ends, self._oldest)
        if self._priorities:
            maximum = float(state["priority_maximum"])
            self._priorities.restore(state["priorities"], maximum, self._exponent(progress))

    def _exponent(self, progress: float) -> float:
        """Of the priorities; 0 for none."""
        return self._config.exponent(progress) if isinstance(self._config, PrioritizedReplay) else 0.0

    def _views(self, numbers: NDArray[np.uint32]) -> dict[str, NDArray[Any]]:
        """The columns of items' numbers, see `Items`."""
        return {
            name: numbers.view(np.int32 if name in self._integers else np.float32)[:, column]
            for column, name in enumerate((*self._integers, *self._floats))
        }

    @property
    def _oldest(self) -> int:
        """Where the oldest item lies, or will."""
        return self._added % self._capacity if self._added > self._capacity else 0

    def _checked_size(self, state: Mapping[str, NDArray[Any]]) -> int:
        """How many items a state holds, once all but its rows fits."""
        name = next(iter(self._dtypes))
        size, cursor = len(state[name]), int(state["cursor"])
        if size > self._capacity:
            raise ValueError(f"replay: {name} holds {size} items, the capacity is {self._capacity}")
        if not (cursor == size % self._capacity if size < self._capacity else 0 <= cursor < size):
            raise ValueError(f"replay: cursor {cursor} does not fit {size} items")
        wanted: dict[str, tuple[np.dtype[Any], tuple[int, ...]]]
        wanted = {name: (dtype, (size,)) for name, dtype in self._dtypes.items()}
        wanted[ROWS] = (np.dtype(np.uint32), state[ROWS].shape[:1])
        if self._priorities:
            wanted |= {"priorities": (np.dtype(np.float64), (size,)), "priority_maximum": (np.dtype(np.float64), ())}
        for name, (dtype, shape) in wanted.items():
            got = state[name]
            if got.dtype != dtype or got.shape != shape:
                raise ValueError(f"replay: {name} is {got.dtype}{got.shape}, not {dtype}{shape}")
        for name in PRIORITIES if self._priorities else ():
            if not (np.isfinite(state[name]) & (state[name] > 0)).all():
                raise ValueError(f"replay: {name} is not above 0 and finite")
        return size

    def _make_sample(self, size: int) -> None:
        """What samples of this size are given out in, and the memory of these arrays."""
        integers = np.zeros((len(self._integers), size), np.int64)
        floats = np.zeros((len(self._floats), size), np.float32)
        weights = np.ones(size, np.float32)
        names = *self._integers, *self._floats
        columns = dict(zip(names, (*integers, *floats), strict=True))
        self._rows_out = self._rows.room_for(size, len(self._row_names))
        rows = {name: self._row(self._rows_out, number, size) for number, name in enumerate(self._row_names)}
        self._sample = Sample(columns, rows, weights, np.zeros(size, np.int64))
        self._numbers_out = integers, floats.view(np.uint32)
        self._draws = np.empty(size)

    def _row(self, memory: RowsOut, number: int, *shape: int) -> SparseRows:
        """The rows [*shape, F] that a row's memory holds."""
        starts, columns, values = (array[number] for array in memory)
        return SparseRows((*shape, self._n_features), starts, columns, values.view(np.float32))


@bare_kernel
def trace_back(
    back: NDArray[Any], oldest: int, capacity: int, places: NDArray[np.int64], chain: NDArray[np.int64]
) -> None:
    """Fill `chain` [L, B] with the places of a train's last items, the last of them being `places` [B]; -1 for none."""
    for item in range(len(places)):
        place = places[item]
        for step in range(len(chain) - 1, -1, -1):
            chain[step, item] = place
            if place >= 0:
                distance = np.int64(back[place])
                age = (place - oldest) % capacity  # places after the oldest
                place = (place - distance) % capacity if 0 < distance <= age else -1
