"""Where a process gets its levels: out of a bank if they are there, else from the generator. They are the same."""

from pathlib import Path

from common.folder import RunFolder
from common.levels import held_out
from common.levels.bank import LevelBank, bank_root
from common.levels.level import Level
from common.seeding import evaluation_level_seed


class LevelSupply:
    """Levels by seed; with a bank or without, the same ones."""

    def __init__(self, levels: object = None, root: Path | None = None, kept: Path | None = None) -> None:
        self._bank = None if root is None or not root.is_dir() else LevelBank(root)

    def level(self, difficulty: str, seed: int) -> Level:
        """The generator's level of a seed."""
        level = None if self._bank is None else self._bank.get(difficulty, seed)
        if level is None:
            from common.levels.legacy import generate  # noqa: PLC0415  (a full bank spares the seconds to import it)

            level = generate(difficulty, seed)
        return level

    def training(self, difficulty: str, seed: int) -> Level:
        """The training level of a seed: never on the rails of an evaluation level (see `held_out`)."""
        return held_out.training_level(difficulty, seed, self.level)

    def evaluation(self, difficulty: str, index: int, sequence: int = 0) -> Level:
        """Evaluation level `index` of a sequence, the same for every run."""
        return self.level(difficulty, evaluation_level_seed(index, sequence))


def supply_of(levels: object, folder: RunFolder) -> LevelSupply:
    return LevelSupply(levels, bank_root(folder.path.parent), folder.path / "levels")
