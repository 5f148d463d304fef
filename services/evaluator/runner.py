"""Scoring a policy: greedy play on the fixed evaluation levels of a difficulty."""

from dataclasses import dataclass

import numpy as np

from common.config import Difficulty
from common.levels.supply import LevelSupply
from common.policy.compiled import Twin
from common.policy.player import Acting, Player, play


@dataclass(frozen=True)
class Score:
    """Means over the levels of an evaluation; steps are environment steps an episode."""

    normalised_return: float
    arrived_share: float
    all_arrived_share: float
    mean_steps: float


def evaluate(player: Player, twin: Twin, supply: LevelSupply, difficulty: Difficulty, levels: int) -> Score:
    """Play the first `levels` evaluation levels greedily and sum up."""
    returns, arrived, steps = [], [], []
    for index in range(levels):
        recording = play(player, supply.evaluation(difficulty, index), Acting(twin, greedy=True))
        returns.append(recording.normalised_return)
        arrived.append(recording.arrived_at >= 0)
        steps.append(recording.last_step)
    return Score(
        normalised_return=float(np.mean(returns)),
        arrived_share=float(np.mean([share.mean() for share in arrived])),
        all_arrived_share=float(np.mean([share.all() for share in arrived])),
        mean_steps=float(np.mean(steps)),
    )
