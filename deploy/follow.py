"""Following a run from outside: its status, and its rows in order with nothing left out, from the first or from now."""

import queue
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from heapq import merge
from typing import Any, Generic, TypeVar

from railctl.common.bus import Bus, NoAnswer
from railctl.common.folder import RunFolder, numbered
from railctl.common.locks import living
from railctl.common.recent import RECENT_EPISODES, mean_of
from railctl.common.records.control import Empty, ProcessStatus, Progress, RunState, Status
from railctl.common.records.rows import HISTORY_PATIENCE_S, EpisodeRow, EvaluationRow, HistoryRequest
from railctl.common.rows import each_row, last_rows
from railctl.common.wire import keys
from railctl.common.wire.keys import Service
from railctl.deploy.growing import GrowingRows
from railctl.deploy.runs import runs_elsewhere

ASK_TIMEOUT_S = 3.0
Row = EpisodeRow | EvaluationRow
R = TypeVar("R", EpisodeRow, EvaluationRow)


def live_status(bus: Bus) -> Status:
    """The status as the supervisor tells it.

    Raises:
        NoAnswer: it does not answer.
    """
    return bus.ask(keys.STATUS, Empty(), ASK_TIMEOUT_S)


def status_from_files(folder: RunFolder) -> Status:
    """The status of a run whose supervisor does not answer."""
    config = folder.config()
    done, recent = last_rows(folder.episodes_file, EpisodeRow, RECENT_EPISODES)
    checkpoints = len(list(folder.checkpoints.glob("*.safetensors"))) * len(config.mix)
    snapshots = [int(path.stem) for path in numbered(folder.snapshots)]
    alive = living(folder)
    outcome, reason = outcome_of(folder)
    away = runs_elsewhere(folder)
    if away is not None:
        reason = away
    elif "supervisor" in alive:
        reason = f"its supervisor, process {alive['supervisor']}, does not answer: it begins or hangs; ask again"
    return Status(
        run=folder.path.name,
        path=str(folder.path),
        state="unsupervised" if alive else outcome if away is None else "running",
        algorithm=config.algorithm,
        episodes=config.episodes,
        supervisor_pid=alive.get("supervisor"),
        progress=Progress(
            done=done,
            leased=0,
            waiting={},
            weights_version=None,
            snapshot=max(snapshots, default=0),
            evaluations=sum(1 for _ in each_row(folder.evaluations_file, EvaluationRow)),
            evaluations_due=checkpoints,
            return_last_100=mean_of(row.normalised_return for row in recent),
            staleness_last_100=mean_of(row.staleness or 0 for row in recent),
            episodes_per_s=0.0,
            steps_per_s=0.0,
            refused=0,
            duplicates=0,
            reissued=0,
        ),
        time_left_s=None,
        problems=[reason[:4000]] if reason else [],
        processes=[_unsupervised(name, pid) for name, pid in alive.items() if name != "supervisor"],
    )


def outcome_of(folder: RunFolder) -> tuple[RunState, str]:
    """How a run that is not running ended, and why."""
    outcome = folder.outcome()
    if outcome is not None:
        return outcome.outcome, outcome.reason
    if folder.path.exists() and not shutil.disk_usage(folder.path).free:
        return "stopped", "the disk is full: make room, then railctl up resumes the run"
    return "stopped", "its supervisor ended without a word: railctl up resumes the run"


def _unsupervised(name: str, pid: int) -> ProcessStatus:
    role, _, rest = name.partition("-")
    return ProcessStatus.model_validate(
        {
            "process": name,
            "role": role,
            "serves": rest.rpartition("-")[0] or None,  # names of levels may have a - in them
            "pid": pid,
            "state": "unsupervised",
            "restarts": 0,
            "last_heartbeat_unix_s": None,
        }
    )


class AskedRows(Generic[R]):
    """The rows of a file on another machine, each once: whoever writes it is asked for them.

    Attributes:
        seen: how many have come.
    """

    def __init__(self, bus: Bus, history: Service[HistoryRequest, Any]) -> None:
        self._bus, self._history = bus, history
        self.seen = 0

    def fresh(self) -> Iterator[R]:
        """The rows that have come since; none while who has them is away, or has much to do."""
        while True:
            try:
                answer = self._bus.ask(self._history, HistoryRequest(first=self.seen), HISTORY_PATIENCE_S)
            except NoAnswer:
                return  # the next row brings what is missing
            self.seen += len(answer.rows)
            yield from answer.rows
            if not answer.rows or self.seen >= answer.total:
                return


class Rows:
    """The rows of a running run: all of history, then what comes, each once and in order.

    Its files have the history, if they are on this machine: then onlookers cost its processes nothing, however many.
    """

    def __init__(self, bus: Bus, folder: RunFolder | None) -> None:
        """`folder` is none for a run on another machine."""
        self._episodes: AskedRows[EpisodeRow] | GrowingRows[EpisodeRow]
        self._evaluations: AskedRows[EvaluationRow] | GrowingRows[EvaluationRow]
        if folder is None:
            self._episodes = AskedRows(bus, keys.EPISODE_HISTORY)
            self._evaluations = AskedRows(bus, keys.EVALUATION_HISTORY)
        else:
            self._episodes = GrowingRows(folder.episodes_file, EpisodeRow)
            self._evaluations = GrowingRows(folder.evaluations_file, EvaluationRow)
        self._fresh: queue.SimpleQueue[Callable[[], Iterable[Row]]] = queue.SimpleQueue()
        bus.subscribe(keys.EPISODE_ROWS, lambda row: self._fresh.put(partial(self._on_episode, row)))
        bus.subscribe(keys.EVALUATION_ROWS, lambda _row: self._fresh.put(self._evaluations.fresh))

    def history(self) -> Iterator[Row]:
        """Everything up to now that has not come yet, evaluations after the episodes that they are of."""
        return merge(self._episodes.fresh(), sorted(self._evaluations.fresh(), key=_place), key=_place)

    def next(self, timeout_s: float) -> Iterable[Row]:
        """What has come since, waiting a while for it."""
        try:
            return self._fresh.get(timeout=timeout_s)()
        except queue.Empty:
            return []

    def _on_episode(self, row: EpisodeRow) -> Iterable[Row]:
        if row.episode < self._episodes.seen:
            return []  # trained again after a restart: the same row
        if row.episode > self._episodes.seen:
            return self._episodes.fresh()  # some got lost on the way
        self._episodes.seen += 1
        return [row]


def rows_from_files(folder: RunFolder) -> Iterator[Row]:
    """All rows on disk, evaluations after the episodes that they are of."""
    return merge(
        each_row(folder.episodes_file, EpisodeRow),
        sorted(each_row(folder.evaluations_file, EvaluationRow), key=_place),
        key=_place,
    )


def wait_until(come_true: Callable[[], bool], patience_s: float) -> bool:
    """Wait for something to come true; false if it does not in time."""
    deadline = time.monotonic() + patience_s
    while not come_true():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def _place(row: Row) -> tuple[int, int]:
    return (row.episode, 1) if isinstance(row, EpisodeRow) else (row.episode - 1, 2)
