"""What users ask of a run, and what they are answered."""

from typing import Annotated, Literal

from pydantic import Field

from railctl.common.config import MAX_ACTORS
from railctl.common.levels.distributions import LevelName
from railctl.common.records.base import Count, Name, Record, Role, Text


class Empty(Record):
    """Asks for something that needs no argument."""


class LearnerCommand(Record):
    """What a user asks of the learner."""

    verb: Literal["pause", "resume", "checkpoint"]


class ScaleRequest(Record):
    """How many actors there shall be for each named distribution, or for any; others stay as they are."""

    actors: dict[LevelName, Annotated[int, Field(ge=0, le=MAX_ACTORS)]]


class CommandAnswer(Record):
    """Whether a command was carried out, and a line for the user."""

    done: bool
    text: Text


class ProcessStatus(Record):
    """A process as its supervisor sees it."""

    process: Name
    role: Role
    serves: LevelName | None  # what an actor serves
    pid: Count | None
    state: Annotated[str, Field(max_length=64)]
    restarts: Count
    last_heartbeat_unix_s: float | None


class Progress(Record):
    """How far a run is, as its learner reports."""

    done: Count
    leased: Count
    waiting: dict[LevelName, Count]  # could be acted now, if an actor asked
    weights_version: Count | None  # only the learner knows
    snapshot: Count  # episodes in the newest snapshot
    evaluations: Count
    evaluations_due: Count
    return_last_100: float | None
    staleness_last_100: float | None
    episodes_per_s: float
    steps_per_s: float
    refused: Count  # messages that the strict decoding turned away
    duplicates: Count
    reissued: Count


RunState = Literal[
    "starting", "running", "paused", "finishing", "finished", "stopping", "stopped", "failed", "unsupervised"
]


class Status(Record):
    """The state of a run and of its processes."""

    run: Text
    path: Text
    state: RunState
    algorithm: Text
    episodes: Count
    supervisor_pid: Count | None
    progress: Progress | None
    time_left_s: float | None
    problems: list[Text] = Field(max_length=100)
    processes: list[ProcessStatus] = Field(max_length=2_000)
