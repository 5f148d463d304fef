"""A row file that somebody else writes, read as it grows: every row once, whatever becomes of the file meanwhile.

A learner that goes on from a snapshot cuts its files back and writes the same episodes again. They were read already:
a row counts by its position, and what comes at a position that was read is passed over.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Generic, TypeVar

from railctl.common.records.base import Record
from railctl.common.rows import row_of, whole_lines_from

R = TypeVar("R", bound=Record)


class GrowingRows(Generic[R]):
    """The rows of a file, from the first on.

    Attributes:
        seen: how many have been read.
    """

    def __init__(self, path: Path, record_type: type[R]) -> None:
        self._path, self._record_type = path, record_type
        self._end, self._last, self._lines = 0, b"", 0  # where what was read ends, its last line, how many it has
        self.seen = 0

    def fresh(self) -> Iterator[R]:
        """The rows that have come since; none if there is no file yet.

        Raises:
            DamagedRows: a whole line is not a valid row.
        """
        if not self._path.exists():
            return
        lines = whole_lines_from(self._path, self._end - len(self._last))
        if self._last and next(lines, b"") != self._last:  # it was cut, and perhaps has grown again
            lines = whole_lines_from(self._path, 0)
            self._end, self._last, self._lines = 0, b"", 0
        for line in lines:
            self._end, self._last, self._lines = self._end + len(line), line, self._lines + 1
            if self._lines > self.seen:
                self.seen += 1
                yield row_of(self._path, self._record_type, self.seen, line)
