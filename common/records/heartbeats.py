"""Signs of life, with what each role reports."""

from typing import Annotated

from pydantic import Field

from railctl.common.levels.distributions import LevelName
from railctl.common.records.base import Count, Name, Record, Role


class LearnerReport(Record):
    """How far learning is."""

    done: Count  # trained episodes
    leased: Count
    waiting: dict[LevelName, Count]  # episodes that could be acted now, if an actor asked
    weights_version: Count
    snapshot: Count  # episodes in the newest snapshot
    checkpoints: Count
    return_last_100: float | None  # None: no episode is trained
    staleness_last_100: float | None
    episodes_per_s: float
    steps_per_s: float
    refused: Count  # messages
    duplicates: Count
    reissued: Count  # leases
    exact_until: Count | None  # None: all of the run has one arithmetic


class ActorReport(Record):
    """What an actor has done."""

    acted: Count  # episodes
    kept: Count  # fragments that are in no snapshot yet


class EvaluatorReport(Record):
    """What the evaluator has done."""

    evaluations: Count  # rows


REPORTS = {"learner": LearnerReport, "actor": ActorReport, "evaluator": EvaluatorReport}
Report = LearnerReport | ActorReport | EvaluatorReport


class Heartbeat(Record):
    """A sign of life from a process's own loop; without a report while it starts."""

    process: Name
    role: Role
    pid: Count
    state: Annotated[str, Field(max_length=64)]
    report: Report | None

    def check(self) -> None:
        """Raises ValueError for the report of another role."""
        if self.report is not None and not isinstance(self.report, REPORTS.get(self.role, type(None))):
            raise ValueError(f"report: role {self.role} sends no {type(self.report).__name__}")
