"""What a tracker is told of a run's rows: numbers by name, each at an episode.

| row | names | at |
|---|---|---|
| episode | `training/return`, `training/arrived_share`, `training/steps`, ... | the episode |
| evaluation | `evaluation/LEVEL/return`, `evaluation/LEVEL/arrived_share`, ... | the episodes that the checkpoint had |
| metric | `learning/loss`, ... as `metrics.jsonl` names them | the episode |
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from railctl.common.records.rows import EpisodeRow, EvaluationRow, MetricRow


class Point(NamedTuple):
    """A number at an episode, and when it came about."""

    name: str
    value: float
    episode: int
    unix_s: float


def points_of(row: EpisodeRow | EvaluationRow | MetricRow, unix_s: float) -> Iterator[Point]:
    """The points of a row; `unix_s` is for rows that do not say when they came about."""
    if isinstance(row, EpisodeRow):
        return _points("training", _of_episode(row), row.episode, row.trained_unix_s)
    if isinstance(row, EvaluationRow):
        return _points(f"evaluation/{row.level}", _of_evaluation(row), row.episode, row.evaluated_unix_s)
    return _points("learning", row.metrics, row.episode, unix_s)


def _points(group: str, numbers: Mapping[str, float | None], episode: int, unix_s: float) -> Iterator[Point]:
    return (Point(f"{group}/{name}", value, episode, unix_s) for name, value in numbers.items() if value is not None)


def _of_episode(row: EpisodeRow) -> dict[str, float | None]:
    return {
        "return": row.normalised_return,
        "arrived_share": row.arrived / row.trains,
        "steps": row.steps,
        "decisions": row.decisions,
        "epsilon": row.epsilon,
        "learned_reward": row.learned_reward,
        "score": row.score,
        "staleness": row.staleness,
    }


def _of_evaluation(row: EvaluationRow) -> dict[str, float | None]:
    return {
        "return": row.normalised_return,
        "arrived_share": row.arrived_share,
        "all_arrived_share": row.all_arrived_share,
        "mean_steps": row.mean_steps,
        "score": row.score,
    }
