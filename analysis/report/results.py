"""What runs have left behind, side by side: their returns, their final scores, and how far each of them got.

Shape letters: A contenders, K levels, R runs (seeds), N episodes, P evaluation points.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.analysis.study import Judgement, PlannedRun, Study
from railctl.common.config import RunConfig

State = Literal["done", "unfinished", "failed", "missing"]


class Scored(NamedTuple):
    """A network, or a reference policy, scored on levels of one distribution."""

    levels: int
    mean: float
    arrived_share: float
    all_arrived_share: float
    returns: tuple[float, ...] = ()  # on every level, where they were kept


@dataclass(frozen=True)
class Trained:
    """A run on one level, as far as it got."""

    state: State = "missing"
    reason: str = ""  # of a failure
    config: RunConfig | None = None
    returns: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))  # [N], normalised, on this level
    unix_s: tuple[float, float] | None = None  # when the first and the last episode were trained
    arithmetic: tuple[tuple[str, str], ...] = ()  # what the learner computed with
    scored: Scored | None = None
    staleness: float | None = None  # of a run with `lag: free`, the mean of its episodes

    @property
    def is_free(self) -> bool:
        """Whether the run would have another curve if it were made again."""
        return self.config is not None and self.config.is_free


class Rectangle(NamedTuple):
    """Levels and seeds that all contenders have."""

    levels: tuple[str, ...]
    seeds: tuple[int, ...]


@dataclass(frozen=True)
class Results:
    """Everything that a report is about."""

    title: str
    contenders: tuple[str, ...]
    levels: tuple[str, ...]
    seeds: tuple[int, ...]
    episodes: int  # of every curve that is compared
    judgement: Judgement
    runs: dict[PlannedRun, Trained]
    scored_by: str  # what final scores are, in words
    references: dict[tuple[str, str], Scored | None] = field(default_factory=dict)  # none: missing
    study: Study | None = None

    @property
    def points(self) -> int:
        """Evaluation points of a whole curve."""
        return self.episodes // self.judgement.block

    def cell(self, contender: str, level: str) -> list[Trained]:
        """The runs of a contender on a level, by seed, also those that are missing."""
        return [found for run, found in self.runs.items() if (run.contender, run.level) == (contender, level)]

    def block_means(self, trained: Trained) -> NDArray[np.float64]:
        """The mean return of every whole block that was trained [P]."""
        block = self.judgement.block
        points = min(self.points, len(trained.returns) // block)
        return np.asarray(trained.returns[: points * block].reshape(points, block).mean(axis=1))

    def is_whole(self, trained: Trained) -> bool:
        """Whether a run's curve can be compared with the others'."""
        return len(trained.returns) >= self.episodes > 0

    def rectangle(self, has: Callable[[Trained], bool]) -> Rectangle | None:
        """The most levels times seeds for which every contender `has` it; none if there are not any.

        Two seeds on fewer levels are better than one on more: of a single run nothing can be said about others.
        """
        found = [
            Rectangle(levels, tuple(seed for seed in self.seeds if self._all(levels, seed, has)))
            for size in range(len(self.levels), 0, -1)
            for levels in combinations(self.levels, size)
        ]
        best = max(found, key=lambda over: (min(len(over.seeds), 2), len(over.levels) * len(over.seeds)))
        return best if best.seeds else None

    def _all(self, levels: Sequence[str], seed: int, has: Callable[[Trained], bool]) -> bool:
        cells = (self.runs.get(PlannedRun(name, level, seed)) for name in self.contenders for level in levels)
        return all(trained is not None and has(trained) for trained in cells)

    def returns(self, over: Rectangle) -> NDArray[np.float64]:
        """Curves [A, K, R, N] of a rectangle of whole runs."""
        runs = [
            self.runs[PlannedRun(contender, level, seed)].returns[: self.episodes]
            for contender in self.contenders
            for level in over.levels
            for seed in over.seeds
        ]
        return np.reshape(runs, (len(self.contenders), len(over.levels), len(over.seeds), self.episodes))

    def scores(self, over: Rectangle) -> dict[str, NDArray[np.float64]]:
        """Final scores [R, K] of each contender, of a rectangle of scored runs."""
        cells = {run: trained.scored.mean for run, trained in self.runs.items() if trained.scored}
        return {
            contender: np.array(
                [[cells[PlannedRun(contender, level, seed)] for level in over.levels] for seed in over.seeds]
            )
            for contender in self.contenders
        }
