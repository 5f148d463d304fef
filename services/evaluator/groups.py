"""Which levels are played: evaluation levels of distributions, or groups of a file; all of them, or one."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from railctl.common.levels.distributions import AnyLevels, LevelFiles, Rules, shipped
from railctl.common.levels.level import Level
from railctl.common.levels.reading import read
from railctl.common.levels.supply import LevelSupply
from railctl.common.requests import EPISODES, LevelChoice
from railctl.common.strict import ConfigError, nearest, shortened


@dataclass(frozen=True)
class Group:
    """Levels that make a row; they may be drawn while they are played."""

    name: str
    rules: Rules
    levels: Iterable[Level]
    count: int
    most_trains: int


class Known(NamedTuple):
    """What a policy knows of levels.

    Attributes:
        levels: distributions, by name.
        default: those that are played if no names are given, the one with the most trains last.
        rules: those that the policy was made for, which levels of a file are played by.
        kept: where a run keeps its level files.
    """

    levels: Mapping[str, AnyLevels]
    default: Sequence[str]
    rules: set[Rules]
    kept: Path | None = None


def known_to_all(choice: LevelChoice) -> Known:
    """What policies know that were made for no levels: those that ship, and those that are given with the choice."""
    return Known(shipped() | choice.own, default=list(shipped()), rules={"legacy"})


def groups_of(choice: LevelChoice, known: Known) -> list[Group]:
    """What is played.

    Raises:
        ConfigError, LevelFileError: as `drawn` and `recorded`.
    """
    if choice.file is not None:
        return list(recorded(choice.file, choice.names, known.rules))
    return drawn(choice, known)


def one_of(choice: LevelChoice, number: int, known: Known) -> tuple[Group, Level]:
    """A level by its number, and the group that it is of; the first of a file, the last default, if none is named.

    Raises:
        ConfigError, LevelFileError: as `groups_of`, or there is no level of this number.
    """
    if choice.file is not None:
        group = next(recorded(choice.file, choice.names, known.rules))
        levels = list(group.levels)
        if number >= len(levels):
            raise ConfigError(
                f"{choice.file}: no level of index {number} in {group.name}, the last is {group.count - 1}"
            )
        return group, levels[number]
    name = choice.names[0] if choice.names else known.default[-1]
    _check_name(choice, name, known.levels)
    held = known.levels[name].evaluation_levels
    if not choice.seed and number >= held:
        raise ConfigError(
            f"--number {number}: {held} evaluation levels of {name} are kept from training: use a lower one"
        )
    group = drawn(choice.model_copy(update={"names": (name,), "episodes": 1}), known)[0]
    return group, _supply(choice, known, name).evaluation(name, number, sequence=choice.seed)


def drawn(choice: LevelChoice, known: Known) -> list[Group]:
    """Evaluation levels of distributions.

    Raises:
        ConfigError: there is no such distribution, or training may have seen some of its levels.
    """
    counts = {name: levels_to_play(choice, name, known.levels) for name in choice.names or known.default}
    return [
        Group(
            name,
            known.levels[name].rules,
            map(partial(_supply(choice, known, name).evaluation, name, sequence=choice.seed), range(count)),
            count,
            known.levels[name].bounds.trains,
        )
        for name, count in counts.items()
    ]


def _supply(choice: LevelChoice, known: Known, name: str) -> LevelSupply:
    """Of a run file's level files there are no copies, even if the run has some under the same name."""
    if name in choice.own:
        return LevelSupply(known.levels, choice.bank, base=choice.base)
    return LevelSupply(known.levels, choice.bank, known.kept)


def levels_to_play(choice: LevelChoice, name: str, known: Mapping[str, AnyLevels]) -> int:
    """How many evaluation levels of a distribution.

    Raises:
        ConfigError: there is no such distribution, or training may have seen some of so many levels.
    """
    _check_name(choice, name, known)
    levels, wanted = known[name], choice.episodes
    if choice.seed:
        return wanted or EPISODES
    if wanted is not None and wanted > levels.evaluation_levels:
        remedy = "use no more"
        if not isinstance(levels, LevelFiles):
            remedy += ", or another --seed, whose rails training may know"
        raise ConfigError(
            f"--episodes {wanted}: {levels.evaluation_levels} evaluation levels of {name} are kept from training: "
            f"{remedy}"
        )
    return wanted or min(EPISODES, levels.evaluation_levels)


def _check_name(choice: LevelChoice, name: str, known: Mapping[str, AnyLevels]) -> None:
    """Raise ConfigError if there is no such distribution, or no other sequence of its levels."""
    if name not in known:
        raise ConfigError(f"unknown level {shortened(name)}{nearest(name, list(known))}")
    if isinstance(known[name], LevelFiles) and choice.seed:
        raise ConfigError(f"--seed {choice.seed}: {name} comes out of files, which have no other levels: leave it out")


def recorded(path: Path, names: Sequence[str] | None, rules: set[Rules]) -> Iterator[Group]:
    """Groups of a file, if none are given all; levels with schedules are played by the stock rules.

    Raises:
        ConfigError: the file lacks a group, or one is empty.
        LevelFileError: it cannot be used.
    """
    groups = read(path).groups
    for name in names or groups:
        if name not in groups:
            raise ConfigError(f"{path} has no group {shortened(name)}{nearest(name, list(groups))}")
        levels = groups[name]
        if not levels:
            raise ConfigError(f"{path}: group {name!r} holds no levels: choose another one")
        is_stock = rules == {"stock"} or any(level.schedule is not None for level in levels)
        most_trains = max(level.n_trains for level in levels)
        yield Group(name, "stock" if is_stock else "legacy", levels, len(levels), most_trains)
