"""The learning curves that reliability is measured on.

Letters in this package: A algorithms, K levels (difficulties; the original's tasks), R runs, N episodes, B episodes a
block, P evaluation points (a block each), Z zones of training, n resamples.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class CurvesError(ValueError):
    """Curves that cannot be judged: one line with the array, its value and the remedy."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Normalised returns [A, K, R, N] in [-1, 0] of equally many, equally long runs of every algorithm on every level.

    Raises:
        CurvesError: something is missing, or does not go together.
    """

    returns: Floats
    block: int  # episodes an evaluation point
    zones: int
    algorithms: tuple[str, ...] = ()  # names; none: algorithm0, algorithm1, ...
    levels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = self.returns.shape
        if len(shape) != 4 or 0 in shape:
            raise CurvesError(f"returns has shape {shape}: give [algorithms, levels, runs, episodes], none of them 0")
        if self.block < 2:
            raise CurvesError(f"block {self.block}: use 2 episodes or more, differences lie within a block")
        if shape[3] % self.block:
            raise CurvesError(f"block {self.block} does not divide {shape[3]} episodes: cut the runs, or use another")
        if not 1 <= self.zones <= self.points:
            raise CurvesError(
                f"n_zones {self.zones}: use 1 to {self.points}, as many as there are blocks of {self.block} episodes"
            )
        self._check_returns()
        for name, size in (("algorithm", shape[0]), ("level", shape[1])):
            self._check_names(name, size)

    def _check_returns(self) -> None:
        wrong = ~((self.returns >= -1) & (self.returns <= 0))  # nan, too
        if wrong.any():
            algorithm, level, run, episode = np.argwhere(wrong)[0]
            value = self.returns[algorithm, level, run, episode]
            remedy = "normalise it to [-1, 0]" if np.isfinite(value) else "every run needs a return for every episode"
            raise CurvesError(
                f"returns[{algorithm}, {level}, {run}, {episode}] (algorithm, level, run, episode) is {value}: {remedy}"
            )

    def _check_names(self, name: str, size: int) -> None:
        names = getattr(self, f"{name}s") or tuple(f"{name}{index}" for index in range(size))
        if len(names) != size:
            raise CurvesError(f"{name}s has {len(names)} names, returns has {size} {name}s: give each one name")
        for index, text in enumerate(names):
            if text in names[:index] or not text.strip() or not text.isprintable():
                raise CurvesError(f"{name}s[{index}] is {text!r}: give each a name of its own")
        object.__setattr__(self, f"{name}s", names)

    @property
    def points(self) -> int:
        """P."""
        return self.returns.shape[3] // self.block

    @cached_property
    def blocks(self) -> Floats:
        """Returns by block [A, K, R, P, B]."""
        return self.returns.reshape(*self.returns.shape[:3], self.points, self.block)

    @cached_property
    def means(self) -> Floats:
        """Mean return of every block [A, K, R, P]."""
        return np.asarray(self.blocks.mean(-1))
