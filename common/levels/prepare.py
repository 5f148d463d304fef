"""What has to be done before a run can use a distribution: whether it can be generated, and what it holds out.

Drawing large evaluation levels takes seconds, so it is done once, with progress, and what is found is kept in the bank.
"""

from pathlib import Path

from railctl.common.levels.build import OnProgress, build
from railctl.common.levels.check import check
from railctl.common.levels.distributions import AnyLevels, LevelFiles
from railctl.common.levels.held_out import AllHeldOutError, draw_hashes, is_prepared, write_hashes
from railctl.common.levels.level import InfeasibleLevelError
from railctl.common.levels.supply import LevelSupply
from railctl.common.seeding import evaluation_level_seed, training_level_seed
from railctl.common.strict import ConfigError

SAMPLE = 3  # training levels that must be there


def prepare(
    root: Path, name: str, levels: AnyLevels, processes: int = 1, on_progress: OnProgress = lambda _progress: None
) -> None:
    """Draw the evaluation levels of a distribution into a bank, and keep the hashes of their rails there.

    Args:
        root: the bank's folder.
        name: of the distribution, for errors.
        levels: the distribution.
        processes: to draw with.
        on_progress: called at the start and after every chunk.

    Raises:
        BankError: the bank is damaged, or a worker failed.
        ConfigError: the distribution cannot be used.
    """
    check(name, levels)
    if isinstance(levels, LevelFiles) or is_prepared(root, levels):
        return
    seeds = [evaluation_level_seed(index) for index in range(levels.held_out)]
    try:
        build(root, levels, seeds, processes, on_progress)
        supply = LevelSupply({name: levels}, root)
        hashes = draw_hashes(levels, lambda _levels, seed: supply.level(name, seed), range(levels.held_out))
        for episode in range(SAMPLE):
            supply.training(name, training_level_seed(0, episode))
    except (InfeasibleLevelError, AllHeldOutError) as error:
        raise ConfigError(f"levels.{name}: {error}") from None
    write_hashes(root, levels, hashes)
