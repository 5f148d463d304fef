"""What a run's rows come to: columns in memory, from which curves are drawn."""

from array import array
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from railctl.analysis.statistics import wilson_interval
from railctl.common.records.rows import EpisodeRow, EvaluationRow, MetricRow
from railctl.deploy.web.thinning import POINTS, Numbers, block_size, moving, sample

DOTS = 1000  # single episodes that are drawn
METRIC_POINTS = 120
RECENT = 100  # episodes over which times are added up
LONGEST_WINDOW = 100
NOTHING = float("nan")


def _numbers() -> "array[float]":
    return array("f")


@dataclass
class LevelColumns:
    """The episodes of one level; all columns are equally long."""

    episode: "array[int]" = field(default_factory=lambda: array("q"))
    normalised_return: "array[float]" = field(default_factory=_numbers)
    arrived: "array[float]" = field(default_factory=_numbers)  # share of the trains
    score: "array[float]" = field(default_factory=_numbers)
    staleness: "array[float]" = field(default_factory=_numbers)

    def add(self, row: EpisodeRow) -> None:
        self.episode.append(row.episode)
        self.normalised_return.append(row.normalised_return)
        self.arrived.append(row.arrived / row.trains)
        self.score.append(NOTHING if row.score is None else row.score)
        self.staleness.append(row.staleness or 0)


MEASURES = {"return": "normalised_return", "arrived": "arrived", "score": "score", "staleness": "staleness"}


class History:
    """All rows of a run up to now."""

    def __init__(self, planned: int) -> None:
        """`planned` episodes are to come."""
        self.window = max(10, min(LONGEST_WINDOW, planned // 10))
        self.episodes = 0
        self.evaluations: list[EvaluationRow] = []
        self._levels: dict[str, LevelColumns] = defaultdict(LevelColumns)

    def extend(self, rows: Iterable[EpisodeRow | EvaluationRow]) -> bool:
        """Add rows; whether there were some."""
        some = False
        for row in rows:
            some = True
            if isinstance(row, EvaluationRow):
                self.evaluations.append(row)
            else:
                self.episodes += 1
                self._levels[row.level].add(row)
        return some

    def curves(self) -> dict[str, Any]:
        """What is drawn: by measure and level, the moving median with quartiles, and single episodes."""
        drawn: dict[str, dict[str, Any]] = {}
        for measure, column in MEASURES.items():
            found = {level: _curve(columns, column, self.window) for level, columns in self._levels.items()}
            drawn[measure] = {level: curve for level, curve in found.items() if curve is not None}
        return {"window": self.window, "measures": {name: curves for name, curves in drawn.items() if curves}}


def _curve(columns: LevelColumns, column: str, window: int) -> dict[str, Any] | None:
    values = as_numbers(getattr(columns, column))
    if np.isnan(values).any() or (column == "staleness" and not values.any()):
        return None
    places = columns.episode
    points = [(places[end - 1] + 1, *rest) for end, *rest in moving(values, window)]
    dots, every = sample([place + 1 for place in places], values, DOTS)
    return {"points": points, "dots": dots, "every": every, "window": max(window, -(-len(values) // POINTS))}


def evaluation_document(row: EvaluationRow) -> dict[str, Any]:
    """An evaluation as the page shows it, with the 95% interval of the share of levels on which all arrived."""
    low, high = wilson_interval(round(row.all_arrived_share * row.levels), row.levels)
    found = row.model_dump(mode="json", by_alias=True, exclude={"weights_digest"})
    return found | {"all_arrived_low": round(low, 4), "all_arrived_high": round(high, 4)}


class Metrics:
    """The columns of `metrics.jsonl`: what learning from each episode showed, and where its time went."""

    def __init__(self) -> None:
        self.episodes = 0
        self._columns: dict[str, array[float]] = {}

    def add(self, row: MetricRow) -> None:
        for name in row.metrics.keys() - self._columns.keys():
            self._columns[name] = array("f", [NOTHING]) * self.episodes
        for name, column in self._columns.items():
            column.append(row.metrics.get(name, NOTHING))
        self.episodes += 1

    def document(self) -> dict[str, Any]:
        """Curves of blocks, and what the last episodes took."""
        columns = {name: as_numbers(column) for name, column in sorted(self._columns.items())}
        return {
            "episodes": self.episodes,
            "recent": min(RECENT, self.episodes),
            "seconds": {name: _sum(values[-RECENT:]) for name, values in columns.items() if name.endswith("_s")},
            "curves": {name: _blocks(values) for name, values in columns.items() if not name.endswith("_s")},
        }


def _blocks(values: Numbers) -> list[tuple[int, float]]:
    """Means of blocks by the episode at their end, of what is a number."""
    size = block_size(len(values), METRIC_POINTS)
    ends = range(size, len(values) + 1, size)
    parts = [values[end - size : end] for end in ends]
    return [
        (end, float(f"{part[~np.isnan(part)].mean():.5g}"))
        for end, part in zip(ends, parts, strict=True)
        if not np.isnan(part).all()
    ]


def _sum(values: Numbers) -> float:
    return round(float(np.nansum(values)), 4)


def as_numbers(column: "array[float]") -> Numbers:
    """A copy of a column: an array that somebody looks into cannot grow."""
    return np.array(column, np.float32)
