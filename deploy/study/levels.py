"""The levels that a study needs, in the bank before its runs start: they find them ready, and generate none twice."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from railctl.analysis.study import PlannedRun, Study
from railctl.common.config import RunConfig
from railctl.common.levels.bank import LevelBank
from railctl.common.levels.chunks import BankError, key_of
from railctl.common.levels.distributions import Generated, LevelFiles
from railctl.common.levels.requests import BuildRequest
from railctl.common.seeding import evaluation_level_seed, training_level_seed
from railctl.deploy.levels import ask
from railctl.deploy.runs import Failed


def missing_levels(study: Study, configs: Mapping[PlannedRun, RunConfig], bank: Path) -> dict[str, int]:
    """How many levels have to be generated; not counted are the few that stand in for those kept from training.

    Raises:
        Failed: the bank cannot be used.
    """
    needed = {training_level_seed(seed, episode) for seed in study.seeds for episode in range(study.episodes)}
    needed |= {evaluation_level_seed(index) for index in range(_evaluation_levels(study, configs))}
    try:
        there = LevelBank(bank)
    except BankError as error:
        raise Failed(str(error)) from None
    return {name: len(needed - there.seeds(key_of(levels))) for name, levels in generated(study, configs).items()}


def generated(study: Study, configs: Mapping[PlannedRun, RunConfig]) -> dict[str, Generated]:
    """Those of a study's distributions that do not come out of files."""
    known = {name: levels for config in configs.values() for name, levels in config.world.levels.items()}
    chosen = {name: known[name] for name in study.levels if name in known}
    return {name: levels for name, levels in chosen.items() if not isinstance(levels, LevelFiles)}


def build_levels(study: Study, configs: Mapping[PlannedRun, RunConfig], bank: Path, processes: int) -> None:
    """Generate what is missing; raises as `run_task`, and as `missing_levels`."""
    lacking = {name for name, count in missing_levels(study, configs, bank).items() if count}
    levels = {name: found for name, found in generated(study, configs).items() if name in lacking}
    for first, last in stretches(study.seeds) if levels else ():
        ask(
            BuildRequest(
                bank=bank,
                levels=levels,
                first_seed=first,
                last_seed=last,
                episodes=study.episodes,
                evaluation=_evaluation_levels(study, configs),
                processes=processes,
            )
        )


def _evaluation_levels(study: Study, configs: Mapping[PlannedRun, RunConfig]) -> int:
    """Of the sequence that runs are evaluated on; others are generated when they are played."""
    final = study.evaluation.episodes if study.evaluation.seed == 0 else 0
    return max(final, *(config.evaluation.levels for config in configs.values()))


def stretches(numbers: Iterable[int]) -> Iterator[tuple[int, int]]:
    """First and last of what follows without a gap.

    >>> list(stretches([3, 1, 2, 7]))
    [(1, 3), (7, 7)]
    """
    first: int | None = None
    last = 0
    for number in sorted(numbers):
        if first is not None and number > last + 1:
            yield first, last
            first = None
        first, last = number if first is None else first, number
    if first is not None:
        yield first, last
