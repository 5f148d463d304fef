"""The level bank: generated levels on disk, shared by all processes. It is a cache of the generators, no more.

A bank is a folder of immutable chunks (see `common.levels.chunks`), a subfolder a distribution (see `key_of`).
Builders only ever add files, so a reader needs no lock; it sees what was there when it looked (`refresh` looks again).
"""

import os
from pathlib import Path

from railctl.common.levels.chunks import SUFFIX, Chunk
from railctl.common.levels.level import Level
from railctl.common.strict import ConfigError, check_is_text


def bank_root(runs: Path) -> Path:
    """Where the bank lies that all runs in a folder share: $RAILCTL_LEVELS, or `.levels` in that folder.

    Raises:
        ConfigError: it cannot be there.
    """
    if not (given := os.environ.get("RAILCTL_LEVELS")):
        return runs / ".levels"
    check_is_text(given, "RAILCTL_LEVELS")
    check_bank(Path(given), f"RAILCTL_LEVELS {given}")
    return Path(given)


def check_bank(root: Path, given: str) -> None:
    """Raise ConfigError if something else than a folder is there; `given`: where it was said, with its value."""
    if os.path.lexists(root) and not root.is_dir():
        raise ConfigError(f"{given}: it is no folder: give another")


class LevelBank:
    """The levels under a folder; one that does not exist is an empty bank."""

    def __init__(self, root: Path) -> None:
        """Open a bank.

        Raises:
            BankError: one of its files cannot be used.
        """
        self.root = root
        self._chunks: dict[Path, Chunk] = {}
        self._places: dict[str, dict[int, tuple[Chunk, int]]] = {}
        self.refresh()

    def refresh(self) -> None:
        """Take notice of chunks that have been added.

        Raises:
            BankError: one of them cannot be used.
        """
        for path in sorted(self.root.glob(f"[!.]*/[!.]*{SUFFIX}")):
            if path not in self._chunks:
                key = path.parent.name
                chunk = self._chunks[path] = Chunk(path, key)
                places = self._places.setdefault(key, {})
                places.update((seed, (chunk, row)) for row, seed in enumerate(chunk.seeds))

    def get(self, key: str, seed: int) -> Level | None:
        """The level that the generator makes of this seed, if it is here.

        Raises:
            BankError: its file is damaged.
        """
        place = self._places.get(key, {}).get(seed)
        return None if place is None else place[0].level(place[1])

    def chunks(self) -> list[Chunk]:
        """All chunks, distribution by distribution."""
        return list(self._chunks.values())

    def keys(self) -> list[str]:
        """The distributions of which there are levels, as `key_of` names them."""
        return list(self._places)

    def seeds(self, key: str) -> frozenset[int]:
        """The seeds whose levels are here."""
        return frozenset(self._places.get(key, ()))

    def holds(self, key: str, seed: int) -> bool:
        """Whether the level of this seed is here."""
        return seed in self._places.get(key, ())
