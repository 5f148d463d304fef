"""What happened to a run, and when: `events.jsonl`, which its supervisor writes and `railctl status` shows."""

import logging
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from railctl.common.compile_signs import COMPILING
from railctl.common.folder import RunFolder
from railctl.common.process import STARTING, Fatal
from railctl.common.records.heartbeats import Heartbeat, LearnerReport
from railctl.common.records.rows import EventKind, EventRow
from railctl.common.rows import DamagedRows, RowFile, last_rows
from railctl.deploy.supervisor import Happening

LONGEST_CHARACTERS = 4000
COUNTS: tuple[tuple[EventKind, str], ...] = (("refused", "messages"), ("reissued", "leases"))  # of a learner's report

log = logging.getLogger(__name__)


class EventLog:
    """The file of a run's events, for the one process that writes it."""

    def __init__(self, folder: RunFolder) -> None:
        """Go on with the file; raises Fatal if it is damaged."""
        try:
            self._file = RowFile(folder.events_file, EventRow)
        except DamagedRows as error:
            raise Fatal(str(error)) from None
        last = next(self._file.read(max(0, self._file.count - 1)), None)
        self._last = "" if last is None else last.time

    def write(self, happening: Happening) -> None:
        """Add an event of now; the order of times is that of the lines, also when somebody sets the clock back."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._last = max(self._last, now)
        try:
            self._file.append(
                EventRow(
                    time=self._last,
                    kind=happening.kind,
                    process=happening.process,
                    text=happening.text[:LONGEST_CHARACTERS],
                )
            )
        except OSError as error:  # a disk without room ends the learner, which says so
            log.warning("no event written: %s", error)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def changes(before: Heartbeat | None, beat: Heartbeat) -> Iterator[Happening]:
    """What a process's sign of life, after the one `before`, says that has happened."""
    if beat.state in (STARTING, COMPILING) or not isinstance(beat.report, LearnerReport):
        return
    was_paused = before is not None and before.state == "paused"
    if was_paused != (beat.state == "paused"):
        kind: EventKind = "resumed" if was_paused else "paused"
        yield Happening(kind, beat.process, f"{kind} after episode {beat.report.done}")
    same = before is not None and before.pid == beat.pid and isinstance(before.report, LearnerReport)
    counted = before.report if before is not None and same else None
    for counts, what in COUNTS:
        total = getattr(beat.report, counts)
        if new := total - getattr(counted, counts, 0):
            yield Happening(counts, beat.process, f"{what} {counts}: {new} (since it started: {total})")


class DamagedSnapshots:
    """Tells of the snapshots that a learner has set aside since this was made."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._known = self._damaged()

    def new(self) -> Iterator[Happening]:
        """Those that nobody has been told of."""
        found = self._damaged()
        for path in sorted(found - self._known):
            yield Happening("skipped", "learner", f"snapshot {path.name} set aside, the run goes on from one before")
        self._known = found

    def _damaged(self) -> set[Path]:
        return set(self._folder.snapshots.glob("*.damaged"))


def last_events(folder: RunFolder, count: int) -> list[EventRow]:
    """The newest events of a run, in order; raises DamagedRows as `last_rows`."""
    return last_rows(folder.events_file, EventRow, count)[1]
