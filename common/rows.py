"""Files of rows: JSON lines that survive a kill. A line that was cut off in mid-write never counts."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Generic, TypeVar

from common.bounded import open_at_once, parse_json
from common.records.base import Record

R = TypeVar("R", bound=Record)

LONGEST_ROW = 65_536  # bytes


class DamagedRows(Exception):  # noqa: N818  (named for what is found)
    """A row file holds something that is not a row; the text names the line."""


def read_rows(path: Path, record_type: type[R]) -> list[R]:
    """All whole rows of a file; none if there is no file.

    Raises:
        DamagedRows: a whole line is not a valid row.
    """
    if not path.exists():
        return []
    rows = []
    for number, line in enumerate(_whole_lines(path), start=1):
        try:
            rows.append(record_type.model_validate(parse_json(line)))
        except ValueError:
            raise DamagedRows(
                f"{path} line {number} is not a valid row: delete this and all later lines to lose only those"
            ) from None
    return rows


def _whole_lines(path: Path) -> Iterator[bytes]:
    """The lines that end; one that is too long to be a row comes in parts, as something that is none."""
    with open_at_once(path) as file:
        while (line := file.readline(LONGEST_ROW)).endswith(b"\n") or len(line) == LONGEST_ROW:
            yield line


class RowFile(Generic[R]):
    """A row file that one process writes."""

    def __init__(self, path: Path, record_type: type[R]) -> None:
        """Open the file and cut off a torn last line.

        Raises:
            DamagedRows: as `read_rows`.
        """
        self.rows = read_rows(path, record_type)
        self._file = path.open("ab")
        self._ends = [0]
        for line in _whole_lines(path):
            self._ends.append(self._ends[-1] + len(line))
        self._file.truncate(self._ends[-1])

    def append(self, row: R) -> None:
        """Write a row; a reader sees it at once, `sync` makes it outlive the machine."""
        line = row.model_dump_json(by_alias=True).encode() + b"\n"
        self._file.write(line)
        self._file.flush()
        self._ends.append(self._ends[-1] + len(line))
        self.rows.append(row)

    def cut(self, count: int) -> list[R]:
        """Keep the first `count` rows; returns those cut off."""
        cut_off = self.rows[count:]
        del self.rows[count:], self._ends[count + 1 :]
        self._file.truncate(self._ends[-1])
        return cut_off

    def sync(self) -> None:
        """Return when all rows are on disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()
