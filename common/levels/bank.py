"""The level bank: generated levels on disk, shared by all processes. It is a cache of `legacy.generate`, no more.

A bank is a folder of immutable chunks (see `common.levels.chunks`), a subfolder a difficulty. Builders only ever add
files, so a reader needs no lock; it sees what was there when it looked (`refresh` looks again).
"""

import os
from pathlib import Path

from common.levels.chunks import SUFFIX, Chunk
from common.levels.distributions import shipped
from common.levels.level import Level


def bank_root(runs: Path) -> Path:
    """Where the bank lies that all runs in a folder share: $RAILCTL_LEVELS, or `.levels` in that folder."""
    return Path(os.environ.get("RAILCTL_LEVELS") or runs / ".levels")


class LevelBank:
    """The levels under a folder; one that does not exist is an empty bank."""

    def __init__(self, root: Path) -> None:
        """Open a bank.

        Raises:
            BankError: one of its files cannot be used.
        """
        self.root = root
        self._chunks: dict[Path, Chunk] = {}
        self._places: dict[str, dict[int, tuple[Chunk, int]]] = {name: {} for name in list(shipped())}
        self.refresh()

    def refresh(self) -> None:
        """Take notice of chunks that have been added.

        Raises:
            BankError: one of them cannot be used.
        """
        for difficulty in list(shipped()):
            places = self._places[difficulty]
            for path in sorted((self.root / difficulty).glob(f"[!.]*{SUFFIX}")):
                if path not in self._chunks:
                    chunk = self._chunks[path] = Chunk(path, difficulty)
                    places.update((seed, (chunk, row)) for row, seed in enumerate(chunk.seeds))

    def get(self, difficulty: str, seed: int) -> Level | None:
        """The level that `legacy.generate` makes of this seed, if it is here.

        Raises:
            BankError: its file is damaged.
        """
        place = self._places[difficulty].get(seed)
        return None if place is None else place[0].level(place[1])

    def chunks(self) -> list[Chunk]:
        """All chunks, difficulty by difficulty."""
        return list(self._chunks.values())

    def seeds(self, difficulty: str) -> frozenset[int]:
        """The seeds whose levels are here."""
        return frozenset(self._places[difficulty])

    def holds(self, difficulty: str, seed: int) -> bool:
        """Whether the level of this seed is here."""
        return seed in self._places[difficulty]
