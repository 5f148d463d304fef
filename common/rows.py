"""Files of rows: JSON lines that survive a kill. A line that was cut off in mid-write never counts."""

import os
from array import array
from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import IO, Generic, TypeVar

from railctl.common.bounded import open_at_once, parse_json
from railctl.common.records.base import Record

R = TypeVar("R", bound=Record)

STRIDE = 1000  # rows from one place that is kept in memory to the next
LONGEST_ROW = 65_536  # bytes


class DamagedRows(Exception):  # noqa: N818  (named for what is found)
    """A row file holds something that is not a row; the text names the line."""


def read_rows(path: Path, record_type: type[R]) -> list[R]:
    """All whole rows of a file; none if there is no file.

    Raises:
        DamagedRows: a whole line is not a valid row.
    """
    return list(each_row(path, record_type))


def each_row(path: Path, record_type: type[R]) -> Iterator[R]:
    """As `read_rows`, one after another: a run may have more than memory holds."""
    if path.exists():
        with open_at_once(path) as file:
            for number, line in enumerate(_whole_lines(file), start=1):
                yield row_of(path, record_type, number, line)


def last_rows(path: Path, record_type: type[R], count: int) -> tuple[int, list[R]]:
    """How many whole rows a file has, and the last `count` of them; the others are only counted.

    Raises:
        DamagedRows: one of the last is not a valid row, or any is too long to be one.
    """
    lines, total = deque[bytes](maxlen=count), 0
    if path.exists():
        with open_at_once(path) as file:
            for line in _whole_lines(file):
                lines.append(line)
                total += 1
                if not line.endswith(b"\n"):
                    row_of(path, record_type, total, line)  # else a file without an end would be counted for ever
    first = total - len(lines) + 1
    return total, [row_of(path, record_type, number, line) for number, line in enumerate(lines, start=first)]


class RowFile(Generic[R]):
    """A row file that one process writes. Its rows stay on disk; in memory is where every thousandth of them begins.

    Attributes:
        count: how many rows there are.
    """

    def __init__(self, path: Path, record_type: type[R], on_row: Callable[[], object] = lambda: None) -> None:
        """Open the file and cut off a torn last line.

        Args:
            path: of the file; it is made if it is not there.
            record_type: what its rows are.
            on_row: is called for every row that is read, now and later: a million take minutes.

        Raises:
            DamagedRows: as `read_rows`.
        """
        self._path, self._record_type, self._on_row = path, record_type, on_row
        self.count = 0
        self._places, self._end = array("q"), 0
        path.touch()
        with path.open("rb") as file:
            for line in _whole_lines(file):
                row_of(path, record_type, self.count + 1, line)
                self._count(line)
                on_row()
        self._file = path.open("ab")
        self._file.truncate(self._end)

    def append(self, row: R) -> None:
        """Write a row; a reader sees it at once, `sync` makes it outlive the machine."""
        line = row.model_dump_json(by_alias=True).encode() + b"\n"
        self._file.write(line)
        self._file.flush()
        self._count(line)

    def read(self, first: int = 0, count: int | None = None) -> Iterator[R]:
        """The rows from number `first` on, at most `count` of them, from disk."""
        end = self.count if count is None else min(self.count, first + count)
        if first >= end:
            return
        with self._path.open("rb") as file:
            self._go_to(first, file)
            for number, line in enumerate(islice(file, end - first), start=first + 1):
                self._on_row()
                yield row_of(self._path, self._record_type, number, line)

    def cut(self, count: int) -> list[R]:
        """Keep the first `count` rows; returns those cut off."""
        cut_off = list(self.read(count))
        if cut_off:
            with self._path.open("rb") as file:
                self._go_to(count, file)
                self.count, self._end = count, file.tell()
            del self._places[-(-count // STRIDE) :]
            self._file.truncate(self._end)
        return cut_off

    def sync(self) -> None:
        """Return when all rows are on disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()

    def _count(self, line: bytes) -> None:
        if self.count % STRIDE == 0:
            self._places.append(self._end)
        self._end += len(line)
        self.count += 1

    def _go_to(self, number: int, file: IO[bytes]) -> None:
        file.seek(self._places[number // STRIDE])
        for _ in range(number % STRIDE):
            file.readline()


def _whole_lines(file: IO[bytes]) -> Iterator[bytes]:
    """The lines that end; one that is too long to be a row comes in parts, as something that is none."""
    while (line := file.readline(LONGEST_ROW)).endswith(b"\n") or len(line) == LONGEST_ROW:
        yield line


def row_of(path: Path, record_type: type[R], number: int, line: bytes) -> R:
    """The row of a whole line, by its number from 1 on; raises DamagedRows."""
    try:
        return record_type.model_validate(parse_json(line))
    except ValueError:
        raise DamagedRows(
            f"{path} line {number} is not a valid row: delete this and all later lines to lose only those"
        ) from None
