"""python -m railctl.services.evaluator.score REQUEST: scores a checkpoint on levels; how it answers: see `common.task`."""

from pathlib import Path
from typing import Any

import numpy as np

from railctl.analysis.statistics import mean_interval
from railctl.common.checkpoint import CheckpointError
from railctl.common.levels.chunks import BankError
from railctl.common.levels.distributions import shipped
from railctl.common.levels.files import LevelFileError
from railctl.common.levels.own import LEVELS
from railctl.common.policy.checkpoints import SavedPolicy, load_policy
from railctl.common.policy.compiled import Twin
from railctl.common.policy.player import player
from railctl.common.requests import LevelChoice, PlaybackRequest, ScoreRequest, asked
from railctl.common.strict import ConfigError
from railctl.common.task import Teller, carry_out, say
from railctl.services.evaluator.groups import Group, Known, groups_of
from railctl.services.evaluator.runner import Policy, Score, UnplayableLevelError, evaluate, greedy, sampled


def score(request: ScoreRequest) -> None:
    """Score the checkpoint on all groups of levels."""
    saved = load_policy(request.checkpoint)
    config, draws = saved.config, draws_seed(request, saved)
    groups = groups_of(request.levels, known_to(saved, request.checkpoint, request.levels))
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


def known_to(saved: SavedPolicy, path: Path, choice: LevelChoice) -> Known:
    """What the policy of a checkpoint, at this path, knows of levels."""
    world = saved.config.world
    known = world.levels | shipped() | choice.own
    return Known(
        known,
        default=sorted(saved.config.mix, key=lambda name: (known[name].bounds.trains, name)),
        rules={levels.rules for levels in world.levels.values()},
        kept=path.parent.parent / LEVELS,  # by its run
    )


def draws_seed(request: ScoreRequest | PlaybackRequest, saved: SavedPolicy) -> int | None:
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
