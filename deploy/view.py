"""What is shown of a run, as plain values: a terminal draws them (`deploy.show`), the page is sent them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from railctl.common.compile_signs import COMPILING
from railctl.common.records.control import ProcessStatus, RunState, Status

SHOWN_PROBLEMS = 3

Tone = Literal["good", "waits", "wrong", "idle"]
TONES: Mapping[RunState, Tone] = {
    "running": "good",
    "finishing": "good",
    "finished": "good",
    "paused": "waits",
    "failed": "wrong",
    "unsupervised": "wrong",
}


@dataclass(frozen=True)
class ProcessView:
    """A process; `silent_s` is the time since its last sign of life, None if there was none."""

    process: str
    role: str
    serves: str
    pid: int | None
    state: str
    restarts: int
    silent_s: float | None


@dataclass(frozen=True)
class ProgressView:
    """How far a run is, and how fast.

    Attributes:
        waiting: episodes that could be acted now, if an actor asked.
        waiting_by_level: the same, by level.
        snapshot: episodes in the newest snapshot.
    """

    done: int
    return_last_100: float | None
    staleness_last_100: float | None
    episodes_per_s: float
    steps_per_s: float
    leased: int
    waiting: int
    waiting_by_level: dict[str, int]
    weights_version: int | None
    snapshot: int
    evaluations: int
    evaluations_due: int


@dataclass(frozen=True)
class RunView:
    """A run as people see it; `starting` says what it does as long as there is no progress, and is then empty."""

    run: str
    state: RunState
    tone: Tone
    algorithm: str
    episodes: int
    progress: ProgressView | None
    time_left_s: float | None
    starting: str
    problems: tuple[str, ...]
    processes: tuple[ProcessView, ...]

    @property
    def alive(self) -> int:
        """How many processes there are."""
        return sum(process.pid is not None for process in self.processes)


def run_view(status: Status, now: float) -> RunView:
    """What to show of a status; `now` is in unix seconds."""
    return RunView(
        run=status.run,
        state=status.state,
        tone=TONES.get(status.state, "idle"),
        algorithm=status.algorithm,
        episodes=status.episodes,
        progress=_progress(status),
        time_left_s=status.time_left_s or None,
        starting=_starting(status),
        problems=tuple(status.problems[-SHOWN_PROBLEMS:]),
        processes=tuple(_process(process, now) for process in status.processes),
    )


def _progress(status: Status) -> ProgressView | None:
    found = status.progress
    if found is None:
        return None
    return ProgressView(
        waiting=sum(found.waiting.values()),
        waiting_by_level=found.waiting,
        **found.model_dump(exclude={"waiting", "refused", "duplicates", "reissued"}),
    )


def _starting(status: Status) -> str:
    if status.progress is not None:
        return ""
    compile_now = [process.process for process in status.processes if process.state == COMPILING]
    return f"{', '.join(compile_now)}: {COMPILING} ..." if compile_now else f"{status.state} ..."


def _process(process: ProcessStatus, now: float) -> ProcessView:
    beat = process.last_heartbeat_unix_s
    return ProcessView(
        process=process.process,
        role=process.role,
        serves=process.serves or "",
        pid=process.pid,
        state=process.state,
        restarts=process.restarts,
        silent_s=None if beat is None else max(0.0, now - beat),
    )
