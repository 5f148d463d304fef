"""Files of a level bank: a header line, then records of one fixed size, mapped into memory when read.

A chunk is written under another name, flushed to the disk and renamed, so whatever has a chunk's name is whole; it is
never changed. Its name is a digest of what it shall hold: whoever builds the same levels makes the same files. Every
record carries the content hash of its level, which is checked whenever the level is read.
"""

import hashlib
import json
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from railctl.common.bounded import parse_json
from railctl.common.levels.distributions import Generated, shipped
from railctl.common.levels.level import Level, Malfunctions, Schedule
from railctl.common.whole import write_whole

SUFFIX = ".levels"
HEADER_BYTES = 256
HASH_BYTES = 16


class BankError(Exception):
    """A bank that cannot be used: one line that names the file, what is wrong and what to do."""


class Kind(NamedTuple):
    """What chunks there are.

    Attributes:
        format: of the file; 1: levels without schedules, 2: with them.
        generator: whose levels these are; to be raised whenever it draws other levels.
    """

    format: int
    generator: str


KINDS = {"legacy": Kind(1, "legacy-1"), "stock": Kind(2, "stock-1")}  # by rules


def key_of(levels: Generated) -> str:
    """The name of a distribution's folder in a bank: its own if it is one that ships, else a digest of its settings.

    >>> key_of(shipped()["easy"])
    'easy'
    """
    return next((name for name, other in shipped().items() if other == levels), levels.identity)


def chunk_name(levels: Generated, seeds: Sequence[int]) -> str:
    """The file name of the chunk of these levels, in this order."""
    kind = KINDS[levels.rules]
    content = f"{kind.format}/{kind.generator}/{key_of(levels)}/{','.join(map(str, seeds))}"
    return hashlib.blake2b(content.encode(), digest_size=16).hexdigest() + SUFFIX


def record_type(kind: Kind, height: int, width: int, trains: int) -> np.dtype[Any]:
    """A level as a record: seed, content hash, and the fields of `Level`; from format 2 on those of its `Schedule`."""
    plain: list[Any] = [
        ("seed", "<u8"),
        ("hash", "u1", (HASH_BYTES,)),
        ("max_steps", "<i4"),
        ("starts", "<i4", (trains, 3)),
        ("targets", "<i4", (trains, 2)),
        ("grid", "<u2", (height, width)),
    ]
    schedule: list[Any] = [
        ("speeds", "<i4", (trains, 2)),
        ("earliest_departures", "<i4", (trains,)),
        ("latest_arrivals", "<i4", (trains,)),
        ("target_headings", "<i4", (trains,)),
        ("rate", "<f8"),  # of malfunctions; 0: there are none
        ("min_steps", "<i4"),
        ("max_malfunction_steps", "<i4"),
    ]
    return np.dtype(plain if kind.format == 1 else plain + schedule)


def write_chunk(path: Path, levels: Generated, seeds: Sequence[int], drawn: Sequence[Level]) -> None:
    """Write a chunk that is on the disk, whole, when this returns.

    Args:
        path: of the file.
        levels: the distribution.
        seeds: of the levels.
        drawn: the levels, all of one shape.
    """
    kind = KINDS[levels.rules]
    (height, width), trains = drawn[0].grid.shape, drawn[0].n_trains
    records = np.zeros(len(drawn), record_type(kind, height, width, trains))
    for record, seed, level in zip(records, seeds, drawn, strict=True):
        record["seed"], record["max_steps"] = seed, level.max_steps
        record["hash"] = np.frombuffer(bytes.fromhex(level.content_hash), np.uint8)
        record["grid"], record["starts"], record["targets"] = level.grid, level.starts, level.targets
        if level.schedule is not None:
            _write_schedule(record, level.schedule)
    header = {
        "format": kind.format,
        "generator": kind.generator,
        "difficulty": key_of(levels),
        "levels": len(drawn),
        "height": height,
        "width": width,
        "trains": trains,
    }
    write_whole(path, json.dumps(header).encode().ljust(HEADER_BYTES - 1) + b"\n", records.tobytes())


def _write_schedule(record: Any, schedule: Schedule) -> None:
    for name in ("speeds", "earliest_departures", "latest_arrivals", "target_headings"):
        record[name] = getattr(schedule, name)
    if schedule.malfunctions is not None:
        record["rate"], record["min_steps"], record["max_malfunction_steps"] = schedule.malfunctions


class Chunk:
    """A chunk that is mapped into memory."""

    def __init__(self, path: Path, key: str) -> None:
        """Map a file.

        Raises:
            BankError: it is no whole chunk of this distribution, or of another format or generator.
        """
        self.path = path
        self.key = key
        header = _header(path)
        self._kind = next((kind for kind in KINDS.values() if kind.format == header.get("format")), KINDS["legacy"])
        want = {"format": self._kind.format, "generator": self._kind.generator, "difficulty": key}
        for field, value in want.items():
            if header.get(field) != value:
                raise BankError(
                    f"{path} has {field} {header.get(field)!r}, not {value!r}: build the bank anew elsewhere"
                )
        try:
            count = int(header["levels"])
            dtype = record_type(self._kind, int(header["height"]), int(header["width"]), int(header["trains"]))
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
            schedule=None if self._kind.format == 1 else self._schedule(row),
        )
        if level.content_hash != self._hashes[row].tobytes().hex():
            raise _damaged(self.path, f"holds another level in place {row} than was written")
        return level

    def _schedule(self, row: int) -> Schedule:
        record = self._records[row]
        rate = float(record["rate"])
        return Schedule(
            speeds=record["speeds"].copy(),
            earliest_departures=record["earliest_departures"].copy(),
            latest_arrivals=record["latest_arrivals"].copy(),
            target_headings=record["target_headings"].copy(),
            malfunctions=Malfunctions(rate, int(record["min_steps"]), int(record["max_malfunction_steps"]))
            if rate > 0
            else None,
        )


def _header(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            header = parse_json(file.read(HEADER_BYTES))
    except (OSError, ValueError):
        raise _damaged(path, "cannot be read") from None
    if not isinstance(header, dict):
        raise _damaged(path, "has no proper header")
    return header


def _damaged(path: Path, problem: str) -> BankError:
    return BankError(f"{path} {problem}: delete it, then railctl levels build makes it again")
