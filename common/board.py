"""The newest weights, where all processes of a machine can read them: a file of slots, shared through its page cache.

A version has the slot of its number modulo their number. A slot is the version, a sum of its numbers, the tensors one
after the other, matrices column by column as twins have them, and the version once more. Both sides move a slot in one
call, which goes from front to back: if a writer overtakes a reader or is overtaken, or is killed in between, the two
versions differ, and on file systems that promise less the sum does. Such a slot is not there, as if it had never been
written; whoever misses a version asks for it. The file is read and written by calls, not mapped: a full disk is then an
error and not a signal.
"""

import errno
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Tensors = Mapping[str, NDArray[np.float32]]

HEADER_BYTES = 8  # a number: the bytes of the JSON that follows it
ALIGNED = 4096
HEAD, TAIL = 2, 1  # int64 numbers before and after the tensors of a slot
MOST_NAMES_BYTES = 1_000_000
NOWHERE: tuple[Any, Any, Any] = (None, None, None)


class Slots:
    """Where everything lies: `count` slots of tensors of these names and shapes, in order."""

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], count: int) -> None:
        self.shapes = dict(shapes)
        self.count = count
        self.header = json.dumps({"count": count, "shapes": self.shapes}).encode()
        size = sum(math.prod(shape) for shape in self.shapes.values())
        self.size = size + size % 2  # whole words, to sum
        self._first = -(-(HEADER_BYTES + len(self.header)) // ALIGNED) * ALIGNED
        self._stride = -(-(8 * (HEAD + TAIL) + 4 * self.size) // ALIGNED) * ALIGNED
        self.file_bytes = self._first + count * self._stride

    @classmethod
    def of_header(cls, header: bytes) -> "Slots":
        """Those that a file's header tells of; raises ValueError, KeyError or TypeError for what is none."""
        told = json.loads(header)
        shapes = {str(name): tuple(int(length) for length in shape) for name, shape in told["shapes"].items()}
        return cls(shapes, int(told["count"]))

    def start(self, version: int) -> int:
        """Where in the file the slot of a version begins."""
        return self._first + version % self.count * self._stride

    def room(self) -> tuple[Any, Any, Any]:  # numpy's stubs know no buffers
        """The three parts of a slot in memory: version and sum, numbers, version."""
        return np.zeros(HEAD, np.int64), np.zeros(self.size, np.float32), np.zeros(TAIL, np.int64)

    def named(self, flat: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Views of a slot's numbers."""
        views, at = {}, 0
        for name, shape in self.shapes.items():
            size = math.prod(shape)
            views[name] = flat[at : at + size].reshape(shape[::-1]).T
            at += size
        return views


class Board:
    """The writing end, of which there is one. It replaces the file of an earlier writer, with all that is in it."""

    def __init__(self, path: Path, like: Tensors, count: int) -> None:
        """The board has `count` slots for tensors `like` these.

        Raises:
            OSError: the disk is full, say.
        """
        self._path = path
        self._slots = Slots({name: array.shape for name, array in like.items()}, count)
        self._head, self._flat, self._tail = self._slots.room()
        self._views = self._slots.named(self._flat)
        temporary = path.with_name(f".{path.name}.tmp")
        self._file = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o644)
        os.posix_fallocate(self._file, 0, self._slots.file_bytes)
        header = self._slots.header
        os.pwrite(self._file, len(header).to_bytes(HEADER_BYTES, "little") + header, 0)
        for slot in range(count):
            self._head[0] = self._tail[0] = -1
            self._write(slot)
        temporary.replace(path)

    def put(self, version: int, tensors: Tensors) -> None:
        """Write a version over that which is `count` older.

        Raises:
            ValueError: the tensors have numbers that are not finite; nothing is written.
            OSError: the disk is full, say.
        """
        for name, view in self._views.items():
            view[...] = tensors[name]
        if not np.isfinite(self._flat).all():
            raise ValueError(f"weights {version} have numbers that are not finite")
        self._head[0] = self._tail[0] = version
        self._head[1] = _sum(self._flat)
        self._write(version)

    def close(self) -> None:
        """Nobody finds anything here any more."""
        self._path.unlink(missing_ok=True)
        os.close(self._file)

    def _write(self, version: int) -> None:
        parts = (self._head, self._flat, self._tail)
        if os.pwritev(self._file, parts, self._slots.start(version)) != sum(part.nbytes for part in parts):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class _Opened(NamedTuple):
    file: int
    identity: tuple[int, int]  # as long as it is held open, no other file has it
    slots: Slots | None  # None: it is no board
    room: tuple[Any, Any, Any]  # read into again and again: fresh memory costs more than what is read


class BoardReader:
    """A reading end; it looks for the board whenever it is asked, and notices a new one."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._opened: _Opened | None = None

    def get(self, version: int) -> dict[str, NDArray[np.float32]] | None:
        """The tensors of a version, good until the next call; None if the board does not have them, or no more."""
        try:
            file, _, slots, room = self._current()
            return None if slots is None else _read(file, slots, room, version)
        except OSError:  # there is no board, here
            return None

    def close(self) -> None:
        """Close the file."""
        if self._opened is not None:
            os.close(self._opened.file)
            self._opened = None

    def _current(self) -> _Opened:
        if self._opened is None or self._opened.identity != _identity(self._path.stat()):
            self.close()
            file = os.open(self._path, os.O_RDONLY)
            there = os.fstat(file)
            slots = _slots_of(file, there.st_size)
            self._opened = _Opened(file, _identity(there), slots, NOWHERE if slots is None else slots.room())
        return self._opened


def _identity(there: os.stat_result) -> tuple[int, int]:
    return there.st_dev, there.st_ino


def _read(file: int, slots: Slots, room: tuple[Any, Any, Any], version: int) -> dict[str, NDArray[np.float32]] | None:
    head, flat, tail = room
    length = os.preadv(file, room, slots.start(version))
    whole = length == sum(part.nbytes for part in room) and head[0] == tail[0] == version and head[1] == _sum(flat)
    return slots.named(flat) if whole else None


def _slots_of(file: int, size: int) -> Slots | None:
    """What an open file says that it holds; None if it is no board."""
    length = int.from_bytes(os.pread(file, HEADER_BYTES, 0), "little")
    try:
        slots = Slots.of_header(os.pread(file, min(length, MOST_NAMES_BYTES), HEADER_BYTES))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return slots if slots.count > 0 and slots.file_bytes == size else None


def _sum(flat: NDArray[np.float32]) -> Any:
    return flat.view(np.int64).sum()
