"""python -m railctl.services.evaluator.score REQUEST: scores a checkpoint on levels; how it answers: see `common.task`."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from railctl.analysis.statistics import mean_interval
from railctl.common.checkpoint import CheckpointError
from railctl.common.levels.chunks import BankError
from railctl.common.levels.distributions import AnyLevels, LevelFiles, Rules, shipped
from railctl.common.levels.files import LevelFileError
from railctl.common.levels.level import Level
from railctl.common.levels.own import LEVELS
from railctl.common.levels.reading import read
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import SavedPolicy, load_policy
from railctl.common.policy.compiled import Twin
from railctl.common.policy.player import player
from railctl.common.requests import EPISODES, LevelChoice, ScoreRequest, asked
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.common.task import Teller, carry_out, say
from railctl.services.evaluator.runner import Policy, Score, UnplayableLevelError, evaluate, greedy, sampled


@dataclass(frozen=True)
class Group:
    """Levels that make a row; they may be drawn while they are played."""

    name: str
    rules: Rules
    levels: Iterable[Level]
    count: int
    most_trains: int


def score(request: ScoreRequest) -> None:
    """Score the checkpoint on all groups of levels."""
    saved = load_policy(request.checkpoint)
    config, draws = saved.config, draws_seed(request, saved)
    known = config.world.levels | shipped() | request.levels.own
    kept = request.checkpoint.parent.parent / LEVELS  # by its run
    rules = {levels.rules for levels in config.world.levels.values()}
    trained = sorted(config.mix, key=lambda name: (known[name].bounds.trains, name))
    groups = groups_of(request.levels, known, trained, rules, kept)
    rows = [played(group, policy_for(group, saved, draws), request.levels.file) for group in groups]
    say(
        {
            "checkpoint": str(request.checkpoint),
            "algorithm": config.algorithm,
            "episode": saved.episode,
            "mode": "greedy" if draws is None else "sample",
            "draws": draws,
            "rows": rows,
        }
    )


def draws_seed(request: ScoreRequest, saved: SavedPolicy) -> int | None:
    """The seed of what is drawn in choosing actions, None for greedy play; unless asked otherwise as in the run.

    Raises:
        ConfigError: there are no probabilities to draw from, or nothing is drawn.
    """
    has_probabilities = saved.config.learning.has_probabilities
    if request.mode == "sample" and not has_probabilities:
        raise ConfigError(
            f"--sample: {saved.config.algorithm} learns action values, which are no probabilities to draw from: "
            "leave it out"
        )
    if (request.mode or saved.config.evaluation.mode) == "sample":
        return saved.config.seed if request.draws is None else request.draws
    if request.draws is not None:
        remedy = "add --sample, or leave it out" if has_probabilities else "leave it out"
        raise ConfigError(f"--draws {request.draws}: greedy play draws nothing: {remedy}")
    return None


def groups_of(
    choice: LevelChoice,
    known: Mapping[str, AnyLevels],
    default: Sequence[str],
    rules: set[Rules],
    kept: Path | None = None,
) -> list[Group]:
    """What is played.

    Args:
        choice: what is asked for.
        known: distributions, by name.
        default: those that are played if no names are given.
        rules: those that the policy was made for, which levels of a file are played by.
        kept: where a run keeps its level files.
    """
    if choice.file is not None:
        return list(recorded(choice.file, choice.names, rules))
    return drawn(choice, known, choice.names or default, kept)


def drawn(choice: LevelChoice, known: Mapping[str, AnyLevels], names: Sequence[str], kept: Path | None) -> list[Group]:
    """Evaluation levels of distributions.

    Raises:
        ConfigError: there is no such distribution, or training may have seen some of its levels.
    """
    counts = {name: levels_to_play(choice, name, known) for name in names}

    def supply_for(name: str) -> LevelSupply:
        """Of a run file's level files there are no copies, even if the run has some under the same name."""
        if name in choice.own:
            return LevelSupply(known, choice.bank, base=choice.base)
        return LevelSupply(known, choice.bank, kept)

    return [
        Group(
            name,
            known[name].rules,
            map(partial(supply_for(name).evaluation, name, sequence=choice.seed), range(count)),
            count,
            known[name].bounds.trains,
        )
        for name, count in counts.items()
    ]


def levels_to_play(choice: LevelChoice, name: str, known: Mapping[str, AnyLevels]) -> int:
    """How many evaluation levels of a distribution.

    Raises:
        ConfigError: there is no such distribution, or training may have seen some of so many levels.
    """
    if name not in known:
        raise ConfigError(f"--level {shortened(name)}{nearest(name, list(known))}")
    levels, wanted = known[name], choice.episodes
    if isinstance(levels, LevelFiles) and choice.seed:
        raise ConfigError(f"--seed {choice.seed}: {name} comes out of files, which have no other levels: leave it out")
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
            raise ConfigError(f"{path}: group {name!r} holds no levels: choose another with --level")
        is_stock = rules == {"stock"} or any(level.schedule is not None for level in levels)
        most_trains = max(level.n_trains for level in levels)
        yield Group(name, "stock" if is_stock else "legacy", levels, len(levels), most_trains)


def policy_for(group: Group, saved: SavedPolicy, draws: int | None) -> Policy:
    """The network as it plays a group; `draws`: see `draws_seed`."""
    has_twin = isinstance(saved.network, Twin)
    playing = player("compiled", saved.config.world, group.rules, group.most_trains, has_twin=has_twin)
    return greedy(playing, saved.network) if draws is None else sampled(playing, saved.network, draws)


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
        "score": score.mean_score,
        "returns": returns.tolist(),
    }


def main() -> None:
    carry_out(lambda: score(asked(ScoreRequest)), CheckpointError, LevelFileError, BankError, UnplayableLevelError)


if __name__ == "__main__":
    main()
