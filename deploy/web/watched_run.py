"""One run that is watched: over its streams while it runs, from its files else; going back and forth by itself."""

import time
from dataclasses import asdict
from typing import Any

from railctl.common.bus import Bus, NoAnswer
from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder, numbered
from railctl.common.locks import living
from railctl.common.records.control import Status
from railctl.common.records.rows import EventRow, MetricRow
from railctl.common.rows import DamagedRows
from railctl.common.strict import ConfigError
from railctl.deploy.events import last_events
from railctl.deploy.follow import Rows, live_status, rows_from_files, status_from_files
from railctl.deploy.growing import GrowingFile
from railctl.deploy.runs import reach
from railctl.deploy.view import run_view
from railctl.deploy.web.history import History, Metrics, evaluation_document
from railctl.deploy.web.looker import Looker

ROWS_S = 0.25  # a wait for the next row
STATUS_EVERY_S = 1.0
CURVES_EVERY_S = 1.0  # drawing takes longer than reading
FILES_EVERY_S = 1.0
SHOWN_EVENTS = 40

Stamp = tuple[tuple[int, int], ...]


class WatchedRun(Looker):
    """Keeps parts: `evaluations`, `run` (what it is and how it is), `curves` and `metrics`."""

    kind = "run"

    def __init__(self, name: str, folder: RunFolder) -> None:
        super().__init__(name)
        self._folder = folder
        self._history = History(0)
        self._metrics = Metrics()
        self._metric_rows = GrowingFile(folder.metrics_file, MetricRow.model_validate_json)
        self._events: tuple[Stamp, list[EventRow]] = ((), [])
        self._shown_evaluations: tuple[History, int] | None = None
        self._curves_due = 0.0
        self._read_from: Stamp | None = None  # the files, when they were read

    def look(self) -> None:
        """As long as the run's cluster answers, or until a second has passed."""
        try:
            config = self._folder.config()  # another run may have taken the name
            try:
                with reach(self._folder) as bus:
                    self._follow(bus, config)
            except NoAnswer as reason:
                self._read(config, str(reason))
        except (ConfigError, DamagedRows, OSError) as error:
            self.tell("run", {"name": self.name, "wrong": str(error)})
        self.pause(FILES_EVERY_S)

    def _follow(self, bus: Bus, config: RunConfig) -> None:
        """Show what comes over the streams, until the run's processes are gone."""
        self._read_from = None
        rows, history = Rows(bus, self._folder), History(config.episodes)
        history.extend(rows.history())
        self._history, is_news, due, silent_since = history, True, 0.0, None
        while not self.ended:
            now = time.monotonic()
            if now >= due:
                due = now + STATUS_EVERY_S
                try:
                    self._show(config, live_status(bus), "live", None)
                    silent_since = None
                except NoAnswer:
                    if not living(self._folder):
                        return
                    silent_since = silent_since or time.time()
                    self._show(config, status_from_files(self._folder), "silent", silent_since)
            is_news = history.extend(rows.next(ROWS_S)) or is_news
            if is_news and self._show_curves(at_once=False):
                is_news = False

    def _read(self, config: RunConfig, reason: str) -> None:
        """Show what the files say; they are read again only if they have changed."""
        stamp = self._stamp(self._folder.episodes_file, self._folder.evaluations_file)
        if stamp != self._read_from:
            self._history = History(config.episodes)
            self._history.extend(rows_from_files(self._folder))
            self._read_from = stamp
        self._show(config, status_from_files(self._folder), "files", None, reason)
        self._show_curves(at_once=True)

    def _stamp(self, *paths: Any) -> Stamp:
        found = [path.stat() for path in paths if path.exists()]
        return tuple((status.st_mtime_ns, status.st_size) for status in found)

    def _show(
        self, config: RunConfig, status: Status, source: str, silent_since: float | None, reason: str = ""
    ) -> None:
        self._show_evaluations()
        now = time.time()
        shown = asdict(run_view(status, now))
        for process in shown["processes"]:
            if process["silent_s"] is not None:
                process["silent_s"] = round(process["silent_s"])
        self.tell(
            "run",
            {
                "name": self.name,
                "source": source,
                "silent_since_unix_s": silent_since,
                "reason": reason,
                "view": shown,
                "levels": list(config.mix),
                "seed": config.seed,
                "lag": config.lag,
                "rule": config.rule,
                "mode": config.evaluation.mode,
                "evaluation_levels": config.evaluation.levels,
                "actors": self._folder.cluster().actors or {},
                "checkpoints": self._checkpoints(),
                "events": [row.model_dump(mode="json") for row in reversed(self._last_events())],
            },
        )

    def _show_evaluations(self) -> None:
        """All of them, which may be many, and therefore only when there is another one."""
        shown = self._history, len(self._history.evaluations)
        if shown != self._shown_evaluations:
            self._shown_evaluations = shown
            found = [evaluation_document(row) for row in self._history.evaluations]
            self.tell("evaluations", {"name": self.name, "evaluations": found})

    def _show_curves(self, *, at_once: bool) -> bool:
        """Draw the curves anew, but not all the time; whether it was done."""
        if not at_once and time.monotonic() < self._curves_due:
            return False
        self._curves_due = time.monotonic() + CURVES_EVERY_S
        self.tell("curves", {"name": self.name} | self._history.curves())
        if self._metric_rows.was_cut():
            self._metric_rows.restart()
            self._metrics = Metrics()
        for row in self._metric_rows.new():
            self._metrics.add(row)
        self.tell("metrics", {"name": self.name} | self._metrics.document())
        return True

    def _checkpoints(self) -> list[int]:
        return [int(path.stem) for path in numbered(self._folder.checkpoints)]

    def _last_events(self) -> list[EventRow]:
        stamp = self._stamp(self._folder.events_file)
        if stamp != self._events[0]:
            self._events = stamp, last_events(self._folder, SHOWN_EVENTS)
        return self._events[1]
