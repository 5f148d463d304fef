"""The newest weights, where all processes of a machine can read them: a file of slots, shared through its page cache.

A version has the slot of its number modulo their number. A slot is the version, a sum of its numbers, the tensors as a
flat array in an order that the file's head tells, and the version once more. Weights that have an order of their own
(`common.policy.flat`) lie in it here too: nobody rearranges them on their way. Both sides move a slot in one call,
which goes from front to back: if a writer overtakes a reader or is overtaken, or is killed in between, the two
versions differ, and on file systems that promise less the sum does. Such a slot is not there, as if it had never been
written; whoever misses a version asks for it. The file is read and written by calls, not mapped: a full disk is then an
error and not a signal.
"""

import errno
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.bounded import parse_json
from railctl.common.kernel import bare_kernel
from railctl.common.policy.flat import Arrays, Flat, Order, Place

HEADER_BYTES = 8  # a number: the bytes of the JSON that follows it
ALIGNED = 4096
HEAD, TAIL = 2, 1  # int64 numbers before and after the tensors of a slot
MOST_NAMES_BYTES = 1_000_000
EXPONENTS, ONES = 0x7F800000_7F800000, 0x00800000_00800000  # of a pair of float32
SIGNS = np.int64(-0x7FFFFFFF_80000000)

Room = tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]


class Slots:
    """Where everything lies: `count` slots of tensors in an order."""

    def __init__(self, order: Order, count: int) -> None:
        self.order = order
        self.count = count
        self.header = json.dumps({"count": count, "size": order.size, "places": order.places}).encode()
        self._first = -(-(HEADER_BYTES + len(self.header)) // ALIGNED) * ALIGNED
        self.slot_bytes = 8 * (HEAD + TAIL) + 4 * order.size
        self._stride = -(-self.slot_bytes // ALIGNED) * ALIGNED
        self.file_bytes = self._first + count * self._stride

    @classmethod
    def of_header(cls, header: bytes) -> "Slots":
        """Those that a file's header tells of; raises ValueError, KeyError or TypeError for what is none."""
        told = parse_json(header)
        places = {
            str(name): Place(tuple(map(int, shape)), int(begin), tuple(map(int, strides)))
            for name, (shape, begin, strides) in told["places"].items()
        }
        return cls(Order(int(told["size"]), places), int(told["count"]))

    def start(self, version: int) -> int:
        """Where in the file the slot of a version begins."""
        return self._first + version % self.count * self._stride

    def room(self) -> Room:
        """The three parts of a slot in memory: version and sum, numbers, version."""
        return np.zeros(HEAD, np.int64), np.zeros(self.order.size, np.float32), np.zeros(TAIL, np.int64)


class Board:
    """The writing end, of which there is one. It replaces the file of an earlier writer, with all that is in it."""

    def __init__(self, path: Path, like: Arrays, count: int) -> None:
        """The board has `count` slots for tensors `like` these.

        Raises:
            OSError: the disk is full, say.
        """
        self._path = path
        self._slots = Slots(Order.of(like), count)
        self._head, nothing, self._tail = self._slots.room()
        temporary = path.with_name(f".{path.name}.tmp")
        self._file = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o644)
        os.posix_fallocate(self._file, 0, self._slots.file_bytes)
        header = self._slots.header
        os.pwrite(self._file, len(header).to_bytes(HEADER_BYTES, "little") + header, 0)
        for slot in range(count):
            self._head[0] = self._tail[0] = -1
            self._write(slot, nothing)
        temporary.replace(path)

    def put(self, version: int, tensors: Arrays) -> None:
        """Write a version over that which is `count` older.

        Raises:
            ValueError: the tensors have numbers that are not finite; nothing is written.
            OSError: the disk is full, say.
        """
        flat = self._slots.order.pack(tensors)
        total, finite = look_over(flat.view(np.int64))
        if not finite:
            raise ValueError(f"weights {version} have numbers that are not finite")
        self._head[:] = version, total
        self._tail[0] = version
        self._write(version, flat)

    def close(self) -> None:
        """Nobody finds anything here any more."""
        self._path.unlink(missing_ok=True)
        os.close(self._file)

    def _write(self, version: int, flat: NDArray[np.float32]) -> None:
        parts: Any = (self._head, flat, self._tail)  # numpy's stubs know no buffers
        start, size = self._slots.start(version), self._slots.slot_bytes
        if (written := os.pwritev(self._file, parts, start)) != size:
            os.pwrite(self._file, bytes(size - written), start + written)  # what did not fit says why
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class _Opened(NamedTuple):
    file: int
    identity: tuple[int, int]  # as long as it is held open, no other file has it
    pages: "_Pages | None"  # None: it is no board


class BoardReader:
    """A reading end; it looks for the board whenever it is asked, and notices a new one."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._opened: _Opened | None = None

    def get(self, version: int) -> Flat | None:
        """The tensors of a version; None if the board does not have them, or no more.

        They are good until the call after the next one that finds some: who takes them over takes no copy.
        """
        try:
            file, _, pages = self._current()
            return None if pages is None else pages.read(file, version)
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
            self._opened = _Opened(file, _identity(there), _pages_of(file, there.st_size))
        return self._opened


def _identity(there: os.stat_result) -> tuple[int, int]:
    return there.st_dev, there.st_ino


@dataclass
class _Pages:
    """Memory for two slots in turn, used again and again: fresh memory costs more than what is read."""

    slots: Slots
    spare: Room
    given: Room

    def read(self, file: int, version: int) -> Flat | None:
        """What the slot of a version holds, if it is whole; else what was given before stays the last."""
        head, flat, tail = parts = self.spare
        buffers: Any = parts  # numpy's stubs know no buffers
        length = os.preadv(file, buffers, self.slots.start(version))
        if length != self.slots.slot_bytes or not head[0] == tail[0] == version:
            return None
        if head[1] != look_over(flat.view(np.int64))[0]:
            return None
        self.spare, self.given = self.given, self.spare
        return Flat(self.slots.order, flat)


def _pages_of(file: int, size: int) -> _Pages | None:
    """Room for what an open file holds; None if it is no board."""
    length = int.from_bytes(os.pread(file, HEADER_BYTES, 0), "little")
    try:
        slots = Slots.of_header(os.pread(file, min(length, MOST_NAMES_BYTES), HEADER_BYTES))
        if slots.count <= 0 or slots.file_bytes != size:
            return None
        pages = _Pages(slots, slots.room(), slots.room())
        slots.order.views(pages.spare[1])
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return pages


@bare_kernel
def look_over(pairs: NDArray[np.int64]) -> tuple[int, bool]:
    """The sum of pairs of float32, by their bits, and whether all are finite.

    The exponents of those that are not are all ones: one more carries into the bit of the sign.
    """
    total = carried = 0
    for pair in pairs:
        total += pair
        carried |= (pair & EXPONENTS) + ONES
    return total, carried & SIGNS == 0
