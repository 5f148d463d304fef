"""Following a file of rows that another process writes, and may cut back when it takes up from a snapshot."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Generic, TypeVar

from railctl.common.bounded import open_at_once
from railctl.common.rows import LONGEST_ROW

R = TypeVar("R")


class RowFollower(Generic[R]):
    """Reads on where it was. A file that was cut is read again from its start."""

    def __init__(self, path: Path, made: Callable[[bytes], R]) -> None:
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

    def new(self) -> Iterator[R]:
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
