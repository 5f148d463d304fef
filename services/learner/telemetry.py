"""The metrics of learning, and where the time goes: a row an episode in `metrics.jsonl`, and TensorBoard event files.

Times are wall-clock seconds of an episode: `acting_s` and `actor_waited_s` (for its leases) as its actors measure,
`learning_s`, `publishing_s` and `learner_waited_s` (for something to learn from) of the learner. `messages` and
`message_bytes` are those that came to the learner or left it. `staleness` is that of `OpenEpisode`.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

from railctl.common.bus import Traffic
from railctl.common.folder import RunFolder
from railctl.common.process import Fatal
from railctl.common.records.rows import MetricRow
from railctl.common.rows import DamagedRows, RowFile
from railctl.services.learner.events import EventFile

Noted = Mapping[str, Sequence[float]]  # of each metric, what the fragments of an episode say

TRAFFIC = ("messages", "message_bytes")
SUMS = ("updates", "transitions", "learning_s", "publishing_s", "learner_waited_s", *TRAFFIC)  # all else is a mean


class Telemetry:
    """The metrics of a run, from its newest snapshot on."""

    def __init__(
        self,
        folder: RunFolder,
        episodes: int,
        traffic: Traffic,
        noted: Noted | None = None,
        on_row: Callable[[], object] = lambda: None,
    ) -> None:
        """Open the files and forget the rows of episodes from number `episodes` on: they are trained again.

        Args:
            folder: of the run.
            episodes: how many are in its newest snapshot.
            traffic: the learner's, counted on elsewhere.
            noted: of the episode that is open in the snapshot, as `noted` gave it then.
            on_row: that of `RowFile`.

        Raises:
            Fatal: the row file is damaged.
        """
        try:
            self._rows = RowFile(folder.metrics_file, MetricRow, on_row)
        except DamagedRows as error:
            raise Fatal(str(error)) from None
        self._rows.cut(sum(row.episode < episodes for row in self._rows.read()))
        self._events = EventFile(folder.tensorboard, episodes)
        self._noted = {name: list(values) for name, values in (noted or {}).items()}
        self._traffic, self._before = traffic, replace(traffic)
        self._idle_since = time.perf_counter()

    @contextmanager
    def learning(self) -> Iterator[None]:
        """What is inside is learning; what was before, since the last publishing, is waiting."""
        begin = time.perf_counter()
        self._note("learner_waited_s", begin - self._idle_since)
        yield
        self._note("learning_s", time.perf_counter() - begin)

    @contextmanager
    def publishing(self) -> Iterator[None]:
        """What is inside is publishing."""
        begin = time.perf_counter()
        yield
        self._idle_since = time.perf_counter()
        self._note("publishing_s", self._idle_since - begin)

    def note(self, metrics: Mapping[str, float]) -> None:
        """Take in the metrics of a fragment."""
        for name, value in metrics.items():
            self._note(name, value)

    def noted(self) -> Noted:
        """What is noted of the open episode so far; nothing between episodes."""
        if self._noted:
            self._note_traffic()
        return self._noted

    def end_episode(self, episode: int, *, acting_s: float, waited_s: float, staleness: int) -> None:
        """The episode is over: write its row."""
        self._note_traffic()
        metrics = {name: sum(values) / (1 if name in SUMS else len(values)) for name, values in self._noted.items()}
        metrics |= {
            "fragments": float(len(self._noted["learning_s"])),
            "acting_s": acting_s,
            "actor_waited_s": waited_s,
            "staleness": float(staleness),
        }
        self._noted = {}
        self._rows.append(MetricRow(episode=episode, metrics={name: round(v, 7) for name, v in metrics.items()}))
        self._events.add(episode, metrics)

    def sync(self) -> None:
        """Return when all rows are on disk."""
        self._rows.sync()

    def close(self) -> None:
        """Close the files."""
        self._rows.close()
        self._events.close()

    def _note_traffic(self) -> None:
        now, before = self._traffic, self._before
        for name, value in zip(TRAFFIC, (now.messages - before.messages, now.size - before.size), strict=True):
            self._note(name, float(value))
        self._before = replace(now)

    def _note(self, name: str, value: float) -> None:
        self._noted.setdefault(name, []).append(value)
