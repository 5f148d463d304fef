"""python -m services.evaluator.score CHECKPOINT: scores a checkpoint on levels; how it answers: see `common.task`."""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from analysis.statistics import mean_interval
from common.checkpoint import CheckpointError
from common.levels import files
from common.levels.chunks import BankError
from common.levels.files import LevelFileError
from common.levels.held_out import HELD_OUT_LEVELS
from common.levels.level import Level
from common.levels.supply import LevelSupply
from common.policy.checkpoints import SavedPolicy, load_policy
from common.policy.compiled import Twin
from common.policy.player import MAX_TRAINS, player
from common.rules.settings import Mode
from common.strict import ConfigError, nearest
from common.task import Teller, carry_out, say
from services.evaluator.runner import Policy, Score, UnplayableLevelError, evaluate, greedy, sampled


@dataclass(frozen=True)
class Group:
    """Levels that make a row; they may be drawn while they are played."""

    name: str
    levels: Iterable[Level]
    count: int
    most_trains: int


def score(options: argparse.Namespace) -> None:
    """Score the checkpoint on all groups of levels."""
    saved = load_policy(options.checkpoint)
    draws = draws_seed(options, saved)
    rows = [
        played(group, policy_for(group, saved.twin, draws), options.levels)
        for group in groups_of(options, saved.trained_on)
    ]
    say(
        {
            "checkpoint": str(options.checkpoint),
            "algorithm": saved.algorithm,
            "episode": saved.episode,
            "mode": "greedy" if draws is None else "sample",
            "draws": draws,
            "rows": rows,
        }
    )


def draws_seed(options: argparse.Namespace, saved: SavedPolicy) -> int | None:
    """The seed of what is drawn in choosing actions, none for greedy play; unless asked otherwise as in the run.

    Raises:
        ConfigError: there are no probabilities to draw from, or nothing is drawn.
    """
    if options.mode == "sample" and not saved.has_probabilities:
        raise ConfigError(
            f"--sample: {saved.algorithm} learns action values, which are no probabilities to draw from: leave it out"
        )
    if (options.mode or saved.mode) == "sample":
        return saved.seed if options.draws is None else int(options.draws)
    if options.draws is not None:
        remedy = "add --sample, or leave it out" if saved.has_probabilities else "leave it out"
        raise ConfigError(f"--draws {options.draws}: greedy play draws nothing: {remedy}")
    return None


def groups_of(options: argparse.Namespace, difficulties: Sequence[str]) -> list[Group]:
    """What is played: groups of a file, or evaluation levels, of the difficulties if `options` name none."""
    if options.levels is not None:
        return list(recorded(options.levels, options.level))
    return drawn(options, options.level or difficulties)


def drawn(options: argparse.Namespace, difficulties: Sequence[str]) -> list[Group]:
    """Evaluation levels of difficulties.

    Raises:
        ConfigError: training may have seen some.
    """
    count, sequence = options.episodes, options.seed
    if sequence == 0 and count > HELD_OUT_LEVELS:
        raise ConfigError(
            f"--episodes {count}: {HELD_OUT_LEVELS} evaluation levels are kept from training: use no more, "
            "or another --seed, whose rails training may know"
        )
    supply = LevelSupply.from_folder(options.bank)
    return [
        Group(name, map(partial(supply.evaluation, name, sequence=sequence), range(count)), count, MAX_TRAINS)
        for name in difficulties
    ]


def recorded(path: Path, names: list[str] | None) -> Iterator[Group]:
    """Groups of a file, if none are given all.

    Raises:
        ConfigError: the file lacks a group, or one is empty.
        LevelFileError: it cannot be used.
    """
    groups = files.load(path)
    for name in names or groups:
        if name not in groups:
            raise ConfigError(f"{path} has no group {name!r}{nearest(name, list(groups))}")
        levels = groups[name]
        if not levels:
            raise ConfigError(f"{path}: group {name!r} holds no levels: choose another with --level")
        yield Group(name, levels, len(levels), max(level.n_trains for level in levels))


def policy_for(group: Group, twin: Twin, draws: int | None) -> Policy:
    """The network as it plays a group; `draws`: see `draws_seed`."""
    playing = player("compiled", group.most_trains)
    return greedy(playing, twin) if draws is None else sampled(playing, twin, draws)


def played(group: Group, policy: Policy, path: Path | None) -> dict[str, Any]:
    """Play a group, of the file of a path if there is one, and sum up."""
    teller = Teller(group.name)
    teller.tell(0, group.count)
    try:
        result = evaluate(policy, group.levels, lambda done: teller.tell(done, group.count))
    except UnplayableLevelError as error:
        raise UnplayableLevelError(f"{path or 'evaluation levels'}: {group.name}, {error}") from error
    return {"level": group.name, "levels": group.count, **summary(result)}


def summary(score: Score) -> dict[str, Any]:
    """The figures of a score; of a single level nothing can be said about the spread."""
    returns = score.returns
    low, high = mean_interval(returns) if len(returns) > 1 else (None, None)
    return {
        "mean": score.mean_return,
        "low": low,
        "high": high,
        "std": float(returns.std(ddof=1)) if len(returns) > 1 else None,
        "median": float(np.median(returns)),
        "arrived_share": score.arrived_share,
        "all_arrived_share": score.all_arrived_share,
        "mean_steps": score.mean_steps,
        "returns": returns.tolist(),
    }


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """What is asked for; none: on this process's own command line."""
    parser = argparse.ArgumentParser(description="Scores a checkpoint.")
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--mode", choices=get_args(Mode), help="default: as its run scores the checkpoint")
    parser.add_argument("--draws", type=int, help="seed of sampling; default: the run's")
    add_levels(parser)
    return parser.parse_args(arguments)


def add_levels(parser: argparse.ArgumentParser) -> None:
    """The options that say what is played."""
    parser.add_argument("--level", action="append", help="difficulty or group; may be repeated")
    parser.add_argument("--levels", type=Path, help="a file of levels; default: evaluation levels")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bank", type=Path)


def main() -> None:
    options = parsed()
    carry_out(lambda: score(options), CheckpointError, LevelFileError, BankError, UnplayableLevelError)


if __name__ == "__main__":
    main()
