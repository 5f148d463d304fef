"""Metrics as event files for TensorBoard, where the optional extra `tensorboard` is installed.

An episode is one event with all its metrics: torch's own writer makes one of each and waits for its thread in between,
which took a quarter of the learner's time.
"""

import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

WAITING_EVENTS = 1000  # for the thread that writes them


class EventFile:
    """A file of a run's events from one episode on; of those in earlier files they take the place.

    It comes with its first event: importing what writes it takes long, and the first episode should not wait for that.
    """

    def __init__(self, folder: Path, first_episode: int) -> None:
        self._folder, self._first_episode = folder, first_episode
        self._is_wanted = find_spec("tensorboard") is not None
        self._file: Any = None

    def add(self, episode: int, metrics: Mapping[str, float]) -> None:
        """The metrics of an episode."""
        if not self._is_wanted:
            return
        from tensorboard.compat.proto.event_pb2 import Event, SessionLog  # noqa: PLC0415  (the extra may be missing)
        from tensorboard.compat.proto.summary_pb2 import Summary  # noqa: PLC0415
        from tensorboard.summary.writer.event_file_writer import EventFileWriter  # noqa: PLC0415

        if self._file is None:
            self._file = EventFileWriter(str(self._folder), WAITING_EVENTS)
            start = SessionLog(status=SessionLog.START)
            self._file.add_event(Event(wall_time=time.time(), step=self._first_episode, session_log=start))
        values = [Summary.Value(tag=name, simple_value=value) for name, value in metrics.items()]
        self._file.add_event(Event(wall_time=time.time(), step=episode, summary=Summary(value=values)))

    def close(self) -> None:
        """Write what waits and close the file."""
        if self._file is not None:
            self._file.close()
