"""Levels that training never sees: those that lie on the rails of an evaluation level.

About one rail map in five comes up again among a thousand draws, so seeds of their own do not keep training and
evaluation apart. The rule is by content: a training level whose rails are those of one of the first `HELD_OUT_LEVELS`
evaluation levels of any difficulty is replaced by the level of a seed derived from its own, and so on. It is a pure
function of (difficulty, seed), wherever levels come from.

The hashes of those rails are a constant of the generator, kept beside this file, because drawing the levels takes a
minute. `python -m common.levels.held_out` draws them again and writes the file.
"""

from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import numpy as np

from common.levels.distributions import shipped
from common.levels.level import Level
from common.seeding import EVALUATION_BIT, evaluation_level_seed, stream_key

HELD_OUT_LEVELS = 1000  # of each difficulty: as many as the final evaluation of the study plays
TRIES = 64  # one in five fails
FILE = Path(__file__).with_suffix(".bin")  # sorted 64-bit hashes, little-endian

Source = Callable[[str, int], Level]  # (difficulty, seed) -> the generator's level


@cache
def held_out_hashes() -> frozenset[int]:
    """The hashes of all rails that are kept from training."""
    return frozenset(np.fromfile(FILE, "<u8").tolist())


def is_held_out(level: Level) -> bool:
    """Whether training may not use this level."""
    return level.grid_hash in held_out_hashes()


def retry_seed(seed: int, attempt: int) -> int:
    """The generator seed of attempt `attempt` at the training level of `seed`; of attempt 0 `seed` itself."""
    return stream_key(seed, attempt, "held-out-retry") & (EVALUATION_BIT - 1) if attempt else seed


def training_level(difficulty: str, seed: int, source: Source) -> Level:
    """The training level of a seed: the first of its attempts that is not held out.

    Raises:
        RuntimeError: all attempts were; it is more likely that the generator is broken.
    """
    for attempt in range(TRIES):
        level = source(difficulty, retry_seed(seed, attempt))
        if not is_held_out(level):
            return level
    raise RuntimeError(f"{TRIES} draws for {difficulty} training level {seed} were all evaluation levels")


def draw_hashes(source: Source, indices: Iterable[int]) -> set[int]:
    """The hashes of the rails of these evaluation levels of all difficulties."""
    return {source(name, evaluation_level_seed(index)).grid_hash for index in indices for name in list(shipped())}


def main() -> None:
    """Write the file anew."""
    from common.levels.legacy import generate  # noqa: PLC0415  (flatland takes seconds to import)

    hashes = draw_hashes(generate, range(HELD_OUT_LEVELS))
    np.array(sorted(hashes), "<u8").tofile(FILE)
    print(f"{FILE.name}: {len(hashes)} maps")  # noqa: T201  (a tool of the maintainers)


if __name__ == "__main__":
    main()
