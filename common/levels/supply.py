"""Where a process gets its levels: out of a bank if they are there, else from the generator; or out of files.

Levels out of files are the run's own copy of them (`common.levels.own`).
"""

from collections.abc import Mapping
from pathlib import Path

from railctl.common.levels import held_out
from railctl.common.levels.bank import LevelBank, bank_root
from railctl.common.levels.chunks import key_of
from railctl.common.levels.distributions import AnyLevels, Generated, LevelFiles, shipped
from railctl.common.levels.generate import generate
from railctl.common.levels.held_out import HeldOut
from railctl.common.levels.level import Level
from railctl.common.levels.own import LEVELS, OwnLevels, read_level_files
from railctl.common.seeding import evaluation_level_seed
from railctl.common.strict import ConfigError


class LevelSupply:
    """Levels of distributions by name; with a bank or without, the same ones."""

    def __init__(
        self,
        levels: Mapping[str, AnyLevels] | None = None,
        root: Path | None = None,
        kept: Path | None = None,
        base: Path | None = None,
    ) -> None:
        """A supply.

        Args:
            levels: the distributions by name; None: those that ship.
            root: the folder of a bank of generated levels, if there is one.
            kept: the folder with a run's own copies of level files.
            base: where the paths of level files start from, of which there are no copies.

        Raises:
            BankError: the bank cannot be used.
        """
        self._levels: Mapping[str, AnyLevels] = shipped() if levels is None else levels
        self._bank = None if root is None or not root.is_dir() else LevelBank(root)
        self._kept = kept
        self._base = base
        self._held_out: dict[str, HeldOut] = {}
        self._own: dict[str, OwnLevels] = {}
        self._keys = {name: key_of(found) for name, found in self._levels.items() if not isinstance(found, LevelFiles)}

    def level(self, name: str, seed: int) -> Level:
        """The generator's level of a seed; out of files, the training level of a seed.

        Raises:
            InfeasibleLevelError: there is none.
        """
        levels = self._levels[name]
        if isinstance(levels, LevelFiles):
            return self._files(name, levels).training(seed)
        banked = None if self._bank is None else self._bank.get(self._keys[name], seed)
        return generate(levels, seed) if banked is None else banked

    def training(self, name: str, seed: int) -> Level:
        """The training level of a seed: never on the rails of an evaluation level (see `held_out`).

        Raises:
            AllHeldOutError: there is next to nothing else.
            InfeasibleLevelError: there is none.
        """
        levels = self._levels[name]
        if isinstance(levels, LevelFiles):
            return self._files(name, levels).training(seed)

        def source(_levels: Generated, wanted: int) -> Level:
            return self.level(name, wanted)

        if name not in self._held_out:
            self._held_out[name] = HeldOut.of(levels, self._bank, source)
        return held_out.training_level(levels, seed, source, self._held_out[name])

    def evaluation(self, name: str, index: int, sequence: int = 0) -> Level:
        """Evaluation level `index` of a sequence, the same for every run; files have but one sequence.

        Raises:
            ConfigError: the files have no such level.
            InfeasibleLevelError: there is none.
        """
        levels = self._levels[name]
        if isinstance(levels, LevelFiles):
            return self._files(name, levels).evaluation(index)
        return self.level(name, evaluation_level_seed(index, sequence))

    def _files(self, name: str, levels: LevelFiles) -> OwnLevels:
        if name not in self._own:
            self._own[name] = self._read(name, levels)
        return self._own[name]

    def _read(self, name: str, levels: LevelFiles) -> OwnLevels:
        if self._kept is not None:
            return OwnLevels.read(self._kept, name, levels)
        if self._base is not None:
            return read_level_files(name, levels, self._base).own(name)
        raise ConfigError(f"levels.{name}: there is no folder with the run's copy of its files: give the run")


def supply_of(levels: Mapping[str, AnyLevels], run: Path) -> LevelSupply:
    """The levels of the run in a folder: from the bank beside it, and its own copies of level files.

    Raises:
        BankError: the bank cannot be used.
    """
    return LevelSupply(levels, bank_root(run.parent), run / LEVELS)
