"""The supervisor's mind. Pure: events and a time in, orders out; no clock, no process, no socket.

A process that dies is started again, later each time; one that dies too often, or says that a restart cannot help, ends
the run with the reason. One that is silent is killed and counts as died. Stopping goes in stages, so that the
learner can still write its snapshot when the actors are gone, and the router goes last.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from railctl.common.config import ClusterConfig
from railctl.common.process import EXIT_FATAL
from railctl.common.records.rows import EventKind
from railctl.deploy.plan import ProcessSpec

FIRST_BACK_OFF_S = 0.5
LONGEST_BACK_OFF_S = 10.0
START_PATIENCE_S = 120.0  # importing takes long on a machine that is busy
STOP_PATIENCE_S = 20.0  # a stage of the stop that takes longer is killed
STAGES = (("actor", "evaluator"), ("learner",), ("router",))

State = Literal["waiting", "starting", "running", "hung", "ending"]


@dataclass(frozen=True)
class Limits:
    """When patience ends."""

    hang_timeout_s: float
    max_restarts: int
    restart_window_s: float

    @classmethod
    def of(cls, cluster: ClusterConfig) -> "Limits":
        """Those of a configuration."""
        return cls(cluster.hang_timeout_s, cluster.max_restarts, cluster.restart_window_s)


# Events


@dataclass(frozen=True)
class Tick:
    """Time passes; `connected`: heartbeats can reach us now."""

    connected: bool


@dataclass(frozen=True)
class Beat:
    process: str
    starts: bool = False  # and says that it gets on with it


@dataclass(frozen=True)
class Exited:
    process: str
    code: int | None  # none: not our child, so nobody knows
    last_words: str


@dataclass(frozen=True)
class Adopted:
    """A process that an earlier supervisor started lives."""

    process: str


@dataclass(frozen=True)
class Wanted:
    """These are the actors that there shall be."""

    actors: tuple[ProcessSpec, ...]


@dataclass(frozen=True)
class StopAsked:
    """End the run; asked again, end it at once."""

    outcome: Literal["finished", "stopped"]


Event = Tick | Beat | Exited | Adopted | Wanted | StopAsked

# Orders


@dataclass(frozen=True)
class Launch:
    spec: ProcessSpec


@dataclass(frozen=True)
class Terminate:
    process: str


@dataclass(frozen=True)
class Kill:
    process: str


@dataclass(frozen=True)
class Quit:
    outcome: Literal["finished", "stopped", "failed"]
    reason: str


Order = Launch | Terminate | Kill | Quit


@dataclass(frozen=True)
class Happening:
    """Something worth to be written down."""

    kind: EventKind
    process: str | None
    text: str


@dataclass
class Ward:
    """A process under supervision."""

    spec: ProcessSpec
    state: State = "waiting"
    since: float = 0.0  # waiting: start then; otherwise: in this state since then
    last_sign: float = 0.0
    deaths: list[float] = field(default_factory=list)
    restarts: int = 0


class Supervisor:
    """Decides what to do about the processes of a run."""

    def __init__(self, specs: Iterable[ProcessSpec], limits: Limits) -> None:
        self.wards = {spec.name: Ward(spec) for spec in specs}
        self.stopping: Quit | None = None
        self.problems: list[str] = []
        self._story: list[Happening] = []
        self._times_asked = 0  # by the user, to stop
        self._wanted = set(self.wards)
        self._limits = limits
        self._connected = False
        self._last_connected = 0.0
        self._learner_came = False

    def on(self, event: Event, now: float) -> list[Order]:
        """What to do about an event at time `now` (seconds on any steady clock)."""
        match event:
            case Tick():
                return self._on_tick(event.connected, now)
            case Beat():
                return self._on_beat(event, now)
            case Exited():
                return self._on_exited(event, now)
            case Adopted():
                return self._on_adopted(event.process, now)
            case Wanted():
                return self._on_wanted(event.actors, now)
            case StopAsked():
                return self._on_stop_asked(event.outcome, now)

    def take_story(self) -> list[Happening]:
        """What has happened since this was last called."""
        story, self._story = self._story, []
        return story

    def _on_tick(self, connected: bool, now: float) -> list[Order]:
        if connected and not self._connected:
            for ward in self.wards.values():  # what was said while we could not hear counts for nobody
                ward.last_sign = now
        if connected:
            self._last_connected = now
        self._connected = connected
        if self.stopping is not None:
            return self._next_stage(now)
        orders: list[Order] = []
        for ward in self.wards.values():
            if ward.state == "waiting" and now >= ward.since and self._has_work(ward):
                orders.append(self._launch(ward, now))
            elif self._overdue(ward, now):
                orders.append(Kill(ward.spec.name))
                if ward.state in ("starting", "running"):
                    silent = f"gave no sign of life for {self._patience_s(ward):g} s"
                    self._tell(
                        "hung", ward.spec.name, f"{silent if self._connected else 'lets nobody connect'}: killed"
                    )
                    ward.state, ward.since = "hung", now
        return orders

    def _has_work(self, ward: Ward) -> bool:
        """An evaluator has none before the learner has come, whose start it would only slow down."""
        return ward.spec.role != "evaluator" or self._learner_came

    def _overdue(self, ward: Ward, now: float) -> bool:
        if ward.state == "ending":
            return now - ward.since > STOP_PATIENCE_S
        if ward.state not in ("starting", "running"):
            return False
        if not self._connected:  # nobody can be heard; if that lasts, it is the router's fault
            return ward.spec.role == "router" and now - max(self._last_connected, ward.since) > START_PATIENCE_S
        return now - max(ward.last_sign, ward.since) > self._patience_s(ward)

    def _patience_s(self, ward: Ward) -> float:
        hang_timeout_s = self._limits.hang_timeout_s
        return max(START_PATIENCE_S, hang_timeout_s) if ward.state == "starting" else hang_timeout_s

    def _launch(self, ward: Ward, now: float) -> Order:
        ward.state, ward.since, ward.last_sign = "starting", now, now
        return Launch(ward.spec)

    def _on_beat(self, beat: Beat, now: float) -> list[Order]:
        if ward := self.wards.get(beat.process):
            ward.last_sign = now
            if beat.starts:
                return []
            self._learner_came |= ward.spec.role == "learner"
            if ward.state == "starting":
                ward.state, ward.since = "running", now
        return []

    def _on_adopted(self, process: str, now: float) -> list[Order]:
        if (ward := self.wards.get(process)) is None:
            return [Kill(process)]  # an actor that nobody wants any more
        self._learner_came |= ward.spec.role == "learner"
        ward.state, ward.since, ward.last_sign = "running", now, now
        return []

    def _on_exited(self, event: Exited, now: float) -> list[Order]:
        ward = self.wards.get(event.process)
        if ward is None:
            return []
        if self.stopping is not None:
            del self.wards[event.process]
            return self._next_stage(now)
        if ward.state == "ending":
            del self.wards[event.process]
            if event.process not in self._wanted:
                return []
            ward = self.wards[event.process] = Ward(ward.spec)  # scaled down, and up again meanwhile
            return [self._launch(ward, now)]
        if event.code == EXIT_FATAL:
            del self.wards[event.process]
            reason = f"{event.process} cannot go on{_colon(event.last_words)}"
            self._story.append(Happening("died", event.process, reason))
            return self._stop(Quit("failed", reason), now)
        return self._on_death(ward, event, now)

    def _on_death(self, ward: Ward, event: Exited, now: float) -> list[Order]:
        window_s = self._limits.restart_window_s
        ward.deaths = [t for t in ward.deaths if now - t < window_s] + [now]
        died = "died" if event.code is None else f"died ({_exit(event.code)})"
        if len(ward.deaths) > self._limits.max_restarts:
            del self.wards[event.process]
            reason = (
                f"{event.process} {died} {len(ward.deaths)} times within {window_s:g} s"
                f"{_colon(event.last_words)}; see logs/{event.process}.log"
            )
            self._story.append(Happening("died", event.process, reason))
            return self._stop(Quit("failed", reason), now)
        ward.restarts += 1
        back_off = min(LONGEST_BACK_OFF_S, FIRST_BACK_OFF_S * 2 ** (len(ward.deaths) - 1))
        ward.state, ward.since = "waiting", now + back_off
        self._tell("died", event.process, f"{died}: starts again in {back_off:g} s")
        return []

    def _on_wanted(self, actors: tuple[ProcessSpec, ...], now: float) -> list[Order]:
        if self.stopping is not None:
            return []
        orders: list[Order] = []
        names = self._wanted = {spec.name for spec in actors}
        for name, ward in list(self.wards.items()):
            if ward.spec.role != "actor" or name in names or ward.state == "ending":
                continue
            if ward.state == "waiting":
                del self.wards[name]
            else:
                ward.state, ward.since = "ending", now
                orders.append(Terminate(name))
        for spec in actors:
            if spec.name not in self.wards:
                self.wards[spec.name] = Ward(spec)
                orders.append(self._launch(self.wards[spec.name], now))
        return orders

    def _on_stop_asked(self, outcome: Literal["finished", "stopped"], now: float) -> list[Order]:
        self._times_asked += outcome == "stopped"
        if self.stopping is None:
            return self._stop(Quit(outcome, ""), now)
        if outcome == "finished" or self._times_asked < 2:
            return []
        return [Kill(name) for name, ward in self.wards.items() if ward.state != "waiting"]

    def _stop(self, end: Quit, now: float) -> list[Order]:
        self.stopping = end
        if end.reason:
            self._note(end.reason)
        for name in [name for name, ward in self.wards.items() if ward.state == "waiting"]:
            del self.wards[name]
        return self._next_stage(now)

    def _next_stage(self, now: float) -> list[Order]:
        assert self.stopping is not None  # noqa: S101  (for the type checker)
        for roles in STAGES:
            stage = [ward for ward in self.wards.values() if ward.spec.role in roles]
            if not stage:
                continue
            orders: list[Order] = []
            for ward in stage:
                if ward.state != "ending":
                    ward.state, ward.since = "ending", now
                    orders.append(Terminate(ward.spec.name))
                elif self._overdue(ward, now):
                    orders.append(Kill(ward.spec.name))
            return orders
        return [self.stopping]

    def _tell(self, kind: EventKind, process: str, text: str) -> None:
        """A trouble of a process."""
        self._story.append(Happening(kind, process, f"{process} {text}"))
        self._note(f"{process} {text}")

    def _note(self, problem: str) -> None:
        self.problems = [*self.problems[-99:], problem]


def _exit(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def _colon(words: str) -> str:
    return f": {words}" if words else ""
