"""The lines of a run's files, and how they are asked for."""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from railctl.common.levels.distributions import LevelName
from railctl.common.records.base import Count, Digest, Name, Record, Text
from railctl.common.rules.settings import Mode

EventKind = Literal[
    "started",
    "adopted",
    "died",
    "hung",
    "scaled",
    "paused",
    "resumed",
    "skipped",
    "refused",
    "reissued",
    "finished",
    "stopped",
    "failed",
]


class EpisodeRow(Record):
    """A line of `episodes.jsonl`: one trained episode. All but `actor` and the two times is a function of the run."""

    episode: Count
    level: LevelName
    seed: Count
    normalised_return: float = Field(alias="return")  # the study's, whatever was learned from
    arrived: Count
    trains: Count
    steps: Count
    decisions: Count
    epsilon: float
    weights_version: Count
    digest: Digest
    actor: Name
    acting_s: float
    trained_unix_s: float
    learned_reward: float | None = None  # sum of the rewards learned from; None: written before it was kept
    score: float | None = None  # flatland-rl 4.3.0's own; None: the level has none, or written before it was kept
    staleness: Count | None = None  # versions of the weights that came while it was acted; None: as of learned_reward

    model_config = ConfigDict(populate_by_name=True)


class MetricRow(Record):
    """A line of `metrics.jsonl`: what learning from an episode showed, and where its time went."""

    episode: Count
    metrics: dict[Annotated[str, Field(max_length=64)], float]


class EvaluationRow(Record):
    """A line of `evaluations.jsonl`: a checkpoint scored on the held-out levels of one distribution."""

    episode: Count
    level: LevelName
    mode: Mode
    levels: Count
    normalised_return: float = Field(alias="return")
    arrived_share: float
    all_arrived_share: float
    mean_steps: float
    weights_digest: Digest
    evaluated_unix_s: float
    evaluating_s: float
    score: float | None = None  # the mean of flatland-rl 4.3.0's own; None: as for episodes

    model_config = ConfigDict(populate_by_name=True)


class EventRow(Record):
    """A line of `events.jsonl`: something that happened to a run or one of its processes."""

    time: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")]  # UTC
    kind: EventKind
    process: Name | None
    text: Text


HISTORY_PATIENCE_S = 10.0  # how long who asks for history waits for it


class HistoryRequest(Record):
    """Asks for rows from position `first` on."""

    first: Count


class EpisodeRows(Record):
    """A stretch of the episode history, starting where it was asked for; `total` rows exist."""

    rows: list[EpisodeRow] = Field(max_length=2_000)
    total: Count


class EvaluationRows(Record):
    """A stretch of the evaluation history, starting where it was asked for; `total` rows exist."""

    rows: list[EvaluationRow] = Field(max_length=2_000)
    total: Count
