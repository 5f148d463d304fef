"""Scoring a policy: greedy play on the fixed evaluation levels of a difficulty."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from common.config import Difficulty
from common.levels.legacy import SPECS, generate
from common.levels.level import Level
from common.policy.acting import EpsilonGreedy
from common.policy.networks import QNetwork
from common.rail.flatland_world import FlatlandWorld
from common.rail.normalise import N_FEATURES
from common.rail.play import play
from common.rail.world import N_ACTIONS
from common.seeding import evaluation_level_seed

MAX_TRAINS = max(spec.trains for spec in SPECS.values())
GREEDY = 0.0


@dataclass(frozen=True)
class Score:
    """Means over the levels of an evaluation; steps are environment steps an episode."""

    normalised_return: float
    arrived_share: float
    all_arrived_share: float
    mean_steps: float


@cache
def evaluation_level(difficulty: Difficulty, index: int) -> Level:
    """Evaluation level `index` of a difficulty: the same for every run."""
    return generate(difficulty, evaluation_level_seed(index))


def evaluate(
    network: QNetwork,
    difficulty: Difficulty,
    levels: int,
    on_step: Callable[[], None],
) -> Score:
    """Play the first `levels` evaluation levels greedily and sum up.

    `on_step` is called before every step and every level; what it raises ends the evaluation.
    """
    world = FlatlandWorld(slots=1, max_trains=MAX_TRAINS)
    policy = EpsilonGreedy(N_FEATURES, N_ACTIONS)
    returns, arrived, steps = [], [], []
    for index in range(levels):
        on_step()
        level = evaluation_level(difficulty, index)
        choose = policy.in_episode(network, GREEDY, key=0, n_trains=level.n_trains)
        [recording] = play(world, [level], [choose], on_step)
        returns.append(recording.normalised_return)
        arrived.append(recording.arrived_at >= 0)
        steps.append(recording.steps)
    return Score(
        normalised_return=float(np.mean(returns)),
        arrived_share=float(np.mean([share.mean() for share in arrived])),
        all_arrived_share=float(np.mean([share.all() for share in arrived])),
        mean_steps=float(np.mean(steps)),
    )
