"""Levels that training never sees: those that lie on the rails of an evaluation level.

About one rail map in five comes up again among a thousand draws, so seeds of their own do not keep training and
evaluation apart. The rule is by content: a training level whose rails are those of one of the evaluation levels of its
own distribution, or of one of the first `HELD_OUT_LEVELS` of those that ship, is replaced by the level of a seed
derived from its own, and so on. It is a pure function of (distribution, seed), wherever levels come from.

The hashes of the rails that ship are a constant of the generator, kept beside this file, because drawing the levels
takes a minute; `python -m railctl.tools.levels.held_out` draws them again. Those of other distributions
are kept in the bank, in the folder of the distribution, once they have been drawn (`common.levels.prepare`).
"""

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from railctl.common.bounded import parse_json, read_bounded
from railctl.common.levels.bank import LevelBank
from railctl.common.levels.chunks import KINDS, key_of
from railctl.common.levels.distributions import AnyLevels, Generated, LevelFiles, shipped
from railctl.common.levels.level import Level
from railctl.common.seeding import EVALUATION_BIT, evaluation_level_seed, stream_key
from railctl.common.whole import write_whole

HELD_OUT_LEVELS = 1000  # of each that ships: as many as the final evaluation of the study plays
TRIES = 512  # one in five fails where there are many maps, nine in ten on the smallest grids
FILE = Path(__file__).with_suffix(".bin")  # sorted 64-bit hashes, little-endian
Source = Callable[[Generated, int], Level]  # (distribution, seed) -> what the generator makes of it

MOST_BYTES = 1_000_000
NAME = "held-out.hashes"  # of such a file in a bank: a header line, then the hashes


class AllHeldOutError(RuntimeError):
    """A distribution has next to no rails besides those of its evaluation levels."""


@cache
def held_out_hashes() -> frozenset[int]:
    """The hashes of all rails of the distributions that ship that are kept from training."""
    return frozenset(np.fromfile(FILE, "<u8").tolist())


def is_held_out(level: Level) -> bool:
    """Whether no training may use this level, of whatever distribution."""
    return level.grid_hash in held_out_hashes()


@dataclass(frozen=True)
class HeldOut:
    """What training on a distribution never sees.

    Attributes:
        hashes: of the rails of its own evaluation levels; what is kept from all training comes on top.
    """

    hashes: frozenset[int]

    def __contains__(self, level: Level) -> bool:
        return level.grid_hash in self.hashes or is_held_out(level)

    @classmethod
    def of(cls, levels: Generated, bank: LevelBank | None, source: Source) -> "HeldOut":
        """What is held out of a distribution: as the bank says, or else drawn, which may take long."""
        if levels == shipped().get(key_of(levels)):
            return cls(frozenset())
        found = None if bank is None else read_hashes(bank.root, levels)
        return cls(frozenset(draw_hashes(levels, source, range(levels.held_out))) if found is None else found)


def retry_seed(seed: int, attempt: int) -> int:
    """The generator seed of attempt `attempt` at the training level of `seed`; of attempt 0 `seed` itself."""
    return stream_key(seed, attempt, "held-out-retry") & (EVALUATION_BIT - 1) if attempt else seed


def training_level(levels: Generated, seed: int, source: Source, held_out: HeldOut) -> Level:
    """The training level of a seed: the first of its attempts that is not held out.

    Raises:
        AllHeldOutError: all attempts were.
    """
    for attempt in range(TRIES):
        level = source(levels, retry_seed(seed, attempt))
        if level not in held_out:
            return level
    raise AllHeldOutError(
        f"{TRIES} draws for training level {seed} were all evaluation levels: make held_out smaller, or size larger"
    )


def draw_hashes(levels: Generated, source: Source, indices: Iterable[int]) -> set[int]:
    """The hashes of the rails of these evaluation levels."""
    return {source(levels, evaluation_level_seed(index)).grid_hash for index in indices}


def is_prepared(root: Path, levels: AnyLevels) -> bool:
    """Whether what is held out of a distribution need not be drawn before a run."""
    if isinstance(levels, LevelFiles) or levels == shipped().get(key_of(levels)):
        return True
    return read_hashes(root, levels) is not None


def write_hashes(root: Path, levels: Generated, hashes: Iterable[int]) -> None:
    """Keep the hashes of a distribution in a bank."""
    content = np.array(sorted(hashes), "<u8").tobytes()
    folder = root / key_of(levels)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / NAME, json.dumps(_header(levels, content)).encode() + b"\n", content)


def read_hashes(root: Path, levels: Generated) -> frozenset[int] | None:
    """The hashes that a bank keeps; None: it has none, or none that are whole and of this generator."""
    try:
        header, _, content = read_bounded(root / key_of(levels) / NAME, MOST_BYTES).partition(b"\n")
        if parse_json(header) != _header(levels, content):
            return None
    except (OSError, ValueError):
        return None
    return frozenset(np.frombuffer(content, "<u8").tolist())


def _header(levels: Generated, content: bytes) -> dict[str, str]:
    return {
        "generator": KINDS[levels.rules].generator,
        "levels": levels.identity,
        "digest": hashlib.blake2b(content, digest_size=16).hexdigest(),
    }
