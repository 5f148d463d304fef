"""From a run's files to a sink: all rows there are, then those that come, until the run ends."""

import fcntl
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from railctl.common.folder import RunFolder
from railctl.common.locks import living
from railctl.common.records.rows import EpisodeRow, EvaluationRow, MetricRow
from railctl.deploy.growing import GrowingRows
from railctl.deploy.mirror.points import Point, points_of
from railctl.deploy.runs import Failed

LOOK_S = 1.0
LOCK = "mirror.lock"


class Sink(Protocol):
    """Where points go."""

    def add(self, point: Point) -> None: ...

    def flush(self) -> None: ...


class Follower:
    """A run's files, read by nobody's leave: the learner does not hear of it."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._episodes = GrowingRows(folder.episodes_file, EpisodeRow)
        self._evaluations = GrowingRows(folder.evaluations_file, EvaluationRow)
        self._metrics = GrowingRows(folder.metrics_file, MetricRow)
        self._unix_s = 0.0  # of the last episode

    def bring(self, sink: Sink) -> None:
        """All that has come since; raises DamagedRows."""
        for episode in self._episodes.fresh():
            self._unix_s = episode.trained_unix_s
            _add_all(sink, points_of(episode, self._unix_s))
        for rows in (self._metrics, self._evaluations):
            for row in rows.fresh():
                _add_all(sink, points_of(row, self._unix_s))
        sink.flush()

    def follow(self, sink: Sink, wait: Callable[[float], None] = time.sleep) -> None:
        """Bring rows as they come, until nothing of the run lives."""
        while living(self._folder):
            self.bring(sink)
            wait(LOOK_S)
        self.bring(sink)


@contextmanager
def alone(folder: RunFolder) -> Iterator[None]:
    """Be the only one that mirrors a run from this machine; raises Failed. Two would bring numbers twice."""
    with (folder.path / LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise Failed(f"run {folder.path.name} is being mirrored already: end that railctl mirror first") from None
        yield


def _add_all(sink: Sink, points: Iterator[Point]) -> None:
    for point in points:
        sink.add(point)
