"""Files of a level bank: a header line, then records of one fixed size, mapped into memory when read.

A chunk is written under another name, flushed to the disk and renamed, so whatever has a chunk's name is whole; it is
never changed. Its name is a digest of what it shall hold: whoever builds the same levels makes the same files. Every
record carries the content hash of its level, which is checked whenever the level is read.
"""

import hashlib
import json
import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from common.levels.level import Level

FORMAT = 1  # of the files; 1: the first
GENERATOR = "legacy-1"  # whose levels these are: to be raised whenever `legacy.generate` draws others
SUFFIX = ".levels"
HEADER_BYTES = 256
HASH_BYTES = 16


class BankError(Exception):
    """A bank that cannot be used: one line that names the file, what is wrong and what to do."""


def chunk_name(difficulty: str, seeds: Sequence[int]) -> str:
    """The file name of the chunk of these levels, in this order."""
    content = f"{FORMAT}/{GENERATOR}/{difficulty}/{','.join(map(str, seeds))}"
    return hashlib.blake2b(content.encode(), digest_size=16).hexdigest() + SUFFIX


def record_type(height: int, width: int, trains: int) -> np.dtype[Any]:
    """A level as a record: seed, content hash, and the fields of `Level`."""
    return np.dtype(
        [
            ("seed", "<u8"),
            ("hash", "u1", (HASH_BYTES,)),
            ("max_steps", "<i4"),
            ("starts", "<i4", (trains, 3)),
            ("targets", "<i4", (trains, 2)),
            ("grid", "<u2", (height, width)),
        ]
    )


def write_chunk(path: Path, difficulty: str, seeds: Sequence[int], levels: Sequence[Level]) -> None:
    """Write a chunk that is on the disk, whole, when this returns. All levels must be of one shape."""
    (height, width), trains = levels[0].grid.shape, levels[0].n_trains
    records = np.zeros(len(levels), record_type(height, width, trains))
    for record, seed, level in zip(records, seeds, levels, strict=True):
        record["seed"], record["max_steps"] = seed, level.max_steps
        record["hash"] = np.frombuffer(bytes.fromhex(level.content_hash), np.uint8)
        record["grid"], record["starts"], record["targets"] = level.grid, level.starts, level.targets
    header = {
        "format": FORMAT,
        "generator": GENERATOR,
        "difficulty": difficulty,
        "levels": len(levels),
        "height": height,
        "width": width,
        "trains": trains,
    }
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(json.dumps(header).encode().ljust(HEADER_BYTES - 1) + b"\n")
            file.write(records.tobytes())
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


class Chunk:
    """A chunk that is mapped into memory."""

    def __init__(self, path: Path, difficulty: str) -> None:
        """Map a file.

        Raises:
            BankError: it is no whole chunk of this difficulty, format and generator.
        """
        self.path = path
        self.difficulty = difficulty
        header = _header(path)
        want = {"format": FORMAT, "generator": GENERATOR, "difficulty": difficulty}
        for key, value in want.items():
            if header.get(key) != value:
                raise BankError(f"{path} has {key} {header.get(key)!r}, not {value!r}: build the bank anew elsewhere")
        try:
            count = int(header["levels"])
            dtype = record_type(int(header["height"]), int(header["width"]), int(header["trains"]))
        except (KeyError, TypeError, ValueError):
            raise _damaged(path, "has no proper header") from None
        if path.stat().st_size != HEADER_BYTES + count * dtype.itemsize:
            raise _damaged(path, "is not as long as its header says")
        mapped = np.memmap(path, dtype, "r", HEADER_BYTES, (count,))
        self._records = mapped.view(np.ndarray)
        self._grids, self._starts, self._targets = (self._records[name] for name in ("grid", "starts", "targets"))
        self._hashes, self._max_steps = self._records["hash"], self._records["max_steps"]

    @cached_property
    def seeds(self) -> list[int]:
        """The seeds of its levels, in order."""
        seeds: list[int] = self._records["seed"].tolist()
        return seeds

    def level(self, row: int) -> Level:
        """The level in place `row`, in memory of its own.

        Raises:
            BankError: it is not what was written.
        """
        level = Level(
            grid=self._grids[row].copy(),
            starts=self._starts[row].copy(),
            targets=self._targets[row].copy(),
            max_steps=int(self._max_steps[row]),
        )
        if level.content_hash != self._hashes[row].tobytes().hex():
            raise _damaged(self.path, f"holds another level in place {row} than was written")
        return level


def _header(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            header = json.loads(file.read(HEADER_BYTES))
    except (OSError, ValueError):
        raise _damaged(path, "cannot be read") from None
    if not isinstance(header, dict):
        raise _damaged(path, "has no proper header")
    return header


def _damaged(path: Path, problem: str) -> BankError:
    return BankError(f"{path} {problem}: delete it, then railctl levels build makes it again")
