"""Scoring a policy: what becomes of every level that it plays."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level
from railctl.common.policy.compiled import Chooser
from railctl.common.policy.player import Acting, Player, play
from railctl.common.records.course import Course
from railctl.common.seeding import evaluation_malfunction_seed, stream_key

Policy = Callable[[int, Level], Course]  # plays a whole episode, given the number of the level, and the level


class UnplayableLevelError(ValueError):
    """A level that cannot be played: one line that gives its number and the reason."""


@dataclass(frozen=True)
class Score:
    """What became of L levels.

    Attributes:
        returns: [L], normalised.
        arrived_shares: [L], of the trains.
        all_arrived: [L].
        steps: [L], environment steps.
        scores: [L], flatland-rl 4.3.0's own; None: a level has none.
    """

    returns: NDArray[np.float64]
    arrived_shares: NDArray[np.float64]
    all_arrived: NDArray[np.bool_]
    steps: NDArray[np.int64]
    scores: NDArray[np.float64] | None = None

    @property
    def mean_return(self) -> float:
        return float(self.returns.mean())

    @property
    def arrived_share(self) -> float:
        return float(self.arrived_shares.mean())

    @property
    def all_arrived_share(self) -> float:
        return float(self.all_arrived.mean())

    @property
    def mean_steps(self) -> float:
        return float(self.steps.mean())

    @property
    def mean_score(self) -> float | None:
        return None if self.scores is None else float(self.scores.mean())


def greedy(player: Player, network: Chooser) -> Policy:
    """Takes the best action."""
    acting = Acting(network, greedy=True)
    return lambda index, level: play(player, level, acting, evaluation_malfunction_seed(index))


def sampled(player: Player, network: Chooser, seed: int) -> Policy:
    """Takes actions as probable as the network says; the draws are those of (seed, number of the level)."""

    def policy(index: int, level: Level) -> Course:
        acting = Acting(network, key=stream_key(seed, index, "evaluation-sample"))
        return play(player, level, acting, evaluation_malfunction_seed(index))

    return policy


def evaluate(policy: Policy, levels: Iterable[Level], on_level: Callable[[int], None] = lambda _done: None) -> Score:
    """Play all levels, one at least; `on_level` hears how many have been played.

    Raises:
        UnplayableLevelError: one cannot be played.
    """
    courses = []
    for index, level in enumerate(levels):
        course = course_of(policy, index, level)
        arrived = course.arrived_at >= 0
        courses.append((course.normalised_return, arrived.mean(), arrived.all(), course.last_step, course.score))
        on_level(index + 1)
    returns, arrived_shares, all_arrived, steps, scores = zip(*courses, strict=True)
    return Score(
        returns=np.array(returns),
        arrived_shares=np.array(arrived_shares),
        all_arrived=np.array(all_arrived),
        steps=np.array(steps),
        scores=None if None in scores else np.array(scores),
    )


def course_of(policy: Policy, index: int, level: Level) -> Course:
    """The episode that a policy plays on the level of a number.

    Raises:
        UnplayableLevelError: it cannot be played.
    """
    try:
        return policy(index, level)
    except ValueError as error:
        raise UnplayableLevelError(f"level {index}: {error}") from error
    except MemoryError:
        rows, columns = level.grid.shape
        size = f"{rows}x{columns} cells, {level.n_trains} trains and {level.max_steps} steps"
        raise UnplayableLevelError(f"level {index}: {size} take more memory than there is") from None
