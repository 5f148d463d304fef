"""Files of rows that somebody else writes, read as they grow.

A learner that goes on from a snapshot cuts its files back and writes the same episodes again.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Generic, TypeVar

from railctl.common.bounded import open_at_once
from railctl.common.records.base import Record
from railctl.common.rows import LONGEST_ROW, row_of

T = TypeVar("T")
R = TypeVar("R", bound=Record)


class GrowingFile(Generic[T]):
    """Reads on where it was. A file that was cut is to be read again from its start."""

    def __init__(self, path: Path, made: Callable[[bytes], T]) -> None:
        """`made` makes of a line what is wanted of it, and raises ValueError if it is none."""
        self._path, self._made = path, made
        self._place, self._last_line = 0, b""

    def was_cut(self) -> bool:
        """Whether what was read is not there any more; then all is to be read anew."""
        if not self._place:
            return False
        try:
            with open_at_once(self._path) as file:
                file.seek(self._place - len(self._last_line))
                return file.read(len(self._last_line)) != self._last_line
        except OSError:
            return True

    def restart(self) -> None:
        self._place, self._last_line = 0, b""

    def new(self) -> Iterator[T]:
        """The whole rows that have come; what is no row is passed over, for whoever needs it complains of it."""
        try:
            file = open_at_once(self._path)
        except OSError:
            return
        with file:
            file.seek(self._place)
            while (line := file.readline(LONGEST_ROW)).endswith(b"\n"):
                self._place += len(line)
                self._last_line = line
                try:
                    row = self._made(line)
                except ValueError:
                    continue
                yield row


class GrowingRows(Generic[R]):
    """The rows of a file, from the first on, every one once: what comes at a position that was read is passed over.

    Attributes:
        seen: how many have been read.
    """

    def __init__(self, path: Path, record_type: type[R]) -> None:
        self._path, self._record_type = path, record_type
        self._lines, self._count = GrowingFile(path, bytes), 0  # since it began, or was cut
        self.seen = 0

    def fresh(self) -> Iterator[R]:
        """The rows that have come since; none if there is no file yet.

        Raises:
            DamagedRows: a whole line is not a valid row.
        """
        if self._lines.was_cut():
            self._lines.restart()
            self._count = 0
        for line in self._lines.new():
            self._count += 1
            if self._count > self.seen:
                self.seen += 1
                yield row_of(self._path, self._record_type, self.seen, line)
