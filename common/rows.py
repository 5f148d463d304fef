"""Files of rows: JSON lines that survive a kill. A line that was cut off in mid-write never counts."""

import json
import os
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import ValidationError

from common.records.base import Record

R = TypeVar("R", bound=Record)


class DamagedRows(Exception):  # noqa: N818  (named for what is found)
    """A row file holds something that is not a row; the text names the line."""


def read_rows(path: Path, record_type: type[R]) -> list[R]:
    """All whole rows of a file; none if there is no file.

    Raises:
        DamagedRows: a whole line is not a valid row.
    """
    if not path.exists():
        return []
    *lines, _torn = path.read_bytes().split(b"\n")
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(record_type.model_validate(json.loads(line)))
        except (ValueError, ValidationError):
            raise DamagedRows(
                f"{path} line {number} is not a valid row: delete this and all later lines to lose only those"
            ) from None
    return rows


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
        for line in path.read_bytes().split(b"\n")[: len(self.rows)]:
            self._ends.append(self._ends[-1] + len(line) + 1)
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
