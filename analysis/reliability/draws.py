"""What is drawn to resample runs.

`KeyedDraws` is ours. `ToolDraws` draws as the original does: numpy's legacy generator is seeded with 0 before every
single interval and p-value, so all algorithms and pairs meet the same draws.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.random import Generator, Philox, RandomState

from railctl.analysis.reliability.curves import Floats, Ints
from railctl.common.seeding import stream_key

TOOL_RESAMPLES = 1000


@dataclass(frozen=True)
class KeyedDraws:
    """A p-value counts what was observed as one more permutation (Phipson & Smyth 2010), so it is never 0."""

    runs: int
    bootstraps: int
    permutations: int
    observed = 1

    def choices(self, levels: int) -> Ints:
        """Runs with replacement [n, K, R]."""
        shape = (self.bootstraps, levels, self.runs)
        return self._stream("bootstrap", levels).integers(self.runs, size=shape)

    def shuffles(self, levels: int) -> Ints:
        """Orders of the runs of two algorithms [n, K, 2R]; the first half goes to the first of them."""
        ordered = np.tile(np.arange(2 * self.runs), (self.permutations, levels, 1))
        return self._stream("permutation", levels).permuted(ordered, axis=-1)

    def _stream(self, purpose: str, levels: int) -> Generator:
        return Generator(Philox(key=stream_key(0, levels, f"reliability-{purpose}")))


@dataclass(frozen=True)
class ToolDraws:
    """The original's draws; a p-value is the share of permutations."""

    runs: int
    bootstraps = permutations = TOOL_RESAMPLES
    observed = 0

    def choices(self, levels: int) -> Ints:
        return RandomState(0).choice(self.runs, size=(self.bootstraps, levels, self.runs))

    def shuffles(self, levels: int) -> Ints:
        state = RandomState(0)
        orders = [state.permutation(2 * self.runs) for _ in range(self.permutations * levels)]
        return np.array(orders).reshape(self.permutations, levels, 2 * self.runs)


Draws = KeyedDraws | ToolDraws


@lru_cache(maxsize=4)
def first_halves(draws: Draws, levels: int) -> Floats:
    """What goes to the first algorithm of a pair: 1, else 0, [n, K * 2R]."""
    shuffles = draws.shuffles(levels)
    first = np.zeros(shuffles.shape)
    np.put_along_axis(first, shuffles[..., : draws.runs], 1, axis=-1)
    return first.reshape(len(first), -1)
