"""The mind of a study: which job is started when. Pure: events in, orders out; no clock, no process, no file.

As many jobs go on at once as there are cores. A job that fails is told of at the end, and the others go on. A run
whose supervisor was killed is taken up again, a few times.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from railctl.analysis.study import PlannedRun, Study, planned_runs

MOST_LOSSES = 3  # of the supervisor of one run


class Scoring(NamedTuple):
    """The final evaluation of a run's network."""

    run: PlannedRun

    @property
    def name(self) -> str:
        return f"evaluation of {self.run.name}"


class Comparing(NamedTuple):
    """The evaluation of a reference policy."""

    policy: str
    level: str

    @property
    def name(self) -> str:
        return f"reference {self.policy} on {self.level}"


class Reporting(NamedTuple):
    """The report on all that is there when nothing else is left to do."""

    name: str = "report"


Job = PlannedRun | Scoring | Comparing | Reporting
State = Literal["waiting", "running", "done", "failed"]

# Events


@dataclass(frozen=True)
class Begin:
    """All that was found has been told."""


@dataclass(frozen=True)
class Adopted:
    """A job goes on that an earlier command started."""

    job: Job


@dataclass(frozen=True)
class Ended:
    """A job is over; lost: its supervisor was killed, and may be started again; stopped: as it was asked to."""

    job: Job
    outcome: Literal["done", "failed", "lost", "stopped"]
    reason: str = ""


@dataclass(frozen=True)
class StopAsked:
    """End everything cleanly; asked again, end it at once."""


Event = Begin | Adopted | Ended | StopAsked

# Orders


@dataclass(frozen=True)
class Start:
    job: Job


@dataclass(frozen=True)
class Stop:
    job: Job


@dataclass(frozen=True)
class Quit:
    """Nothing is left that could be done."""


Order = Start | Stop | Quit


class Dispatcher:
    """Decides what is done next."""

    def __init__(self, jobs: Sequence[Job], cores: int) -> None:
        self.states: dict[Job, State] = dict.fromkeys(jobs, "waiting")
        self.failures: dict[Job, str] = {}
        self.stopping = False
        self._cores = cores
        self._losses: dict[Job, int] = {}

    def on(self, event: Event) -> list[Order]:
        """What to do about an event."""
        match event:
            case Begin():
                return self._fill()
            case Adopted():
                self.states[event.job] = "running"
                return []
            case Ended():
                return self._on_ended(event)
            case StopAsked():
                self.stopping = True
                return [*map(Stop, self.running()), *self._fill()]

    def running(self) -> list[Job]:
        """The jobs that go on."""
        return [job for job, state in self.states.items() if state == "running"]

    def _on_ended(self, event: Ended) -> list[Order]:
        was_running = self.states[event.job] == "running"
        if self.stopping and event.outcome != "done":
            event = Ended(event.job, "stopped")
        if event.outcome == "lost":
            losses = self._losses[event.job] = self._losses.get(event.job, 0) + 1
            if losses > MOST_LOSSES:
                event = Ended(event.job, "failed", f"its supervisor was killed {losses} times")
        if event.outcome == "failed":
            self.failures[event.job] = event.reason
        after: dict[str, State] = {"done": "done", "failed": "failed"}
        self.states[event.job] = after.get(event.outcome, "waiting")
        return self._fill() if was_running else []

    def _fill(self) -> list[Order]:
        """Give every free core a job; without any job left, the end."""
        orders: list[Order] = []
        while not self.stopping and len(self.running()) < self._cores and (job := self._next()) is not None:
            self.states[job] = "running"
            orders.append(Start(job))
        return orders if self.running() else [Quit()]

    def _next(self) -> Job | None:
        return next((job for job, state in self.states.items() if state == "waiting" and self._may_start(job)), None)

    def _may_start(self, job: Job) -> bool:
        match job:
            case Scoring():
                return self.states[job.run] == "done"
            case Reporting():
                return not self.running()
            case _:
                return True


def in_order(study: Study, run_seconds: Mapping[tuple[str, str], float], alive: Container[PlannedRun]) -> list[Job]:
    """All jobs of a study, the most urgent first.

    A network is scored when it has been trained. Runs come seed by seed, so that what is done at any time compares all
    contenders, those of a seed by their expected seconds, the longest first, so that no core idles at the end for long;
    of what nothing is known may take longest. Before them come those of which something is alive still.
    """

    def place(run: PlannedRun) -> tuple[bool, int, float]:
        return run not in alive, study.seeds.index(run.seed), -run_seconds.get(run[:2], float("inf"))

    runs = sorted(planned_runs(study), key=place)
    references = [Comparing(policy, level) for policy in study.references for level in study.levels]
    return [*map(Scoring, runs), *runs, *references, Reporting()]
