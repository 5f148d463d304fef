"""Checking a level bank: every level is as it was written, and a sample is what the generator draws today."""

from collections.abc import Callable, Mapping
from pathlib import Path

from railctl.common.levels.bank import LevelBank
from railctl.common.levels.chunks import BankError
from railctl.common.levels.distributions import Generated
from railctl.common.levels.generate import generate


def verify(
    root: Path,
    sample: int,
    known: Mapping[str, Generated],
    on_level: Callable[[int, int], None] = lambda _done, _total: None,
) -> int:
    """Read all levels of a bank, and draw an even sample of them again; returns how many levels there are.

    Args:
        root: the bank's folder.
        sample: how many levels to draw again, at most; those of unknown distributions cannot be.
        known: the distributions, by the names of their folders.
        on_level: told the number of levels that have been checked, and of all.

    Raises:
        BankError: naming the first file that is damaged or of another generator.
    """
    chunks = LevelBank(root).chunks()
    total = sum(len(chunk.seeds) for chunk in chunks)
    every = max(1, total // sample) if sample else total + 1
    done = 0
    for chunk in chunks:
        levels = known.get(chunk.key)
        for row, seed in enumerate(chunk.seeds):
            level = chunk.level(row)
            is_drawn = done % every == every - 1
            if is_drawn and levels and generate(levels, seed).content_hash != level.content_hash:
                raise BankError(f"{chunk.path} holds another {chunk.key} level than the generator makes of {seed}")
            done += 1
            on_level(done, total)
    return total
