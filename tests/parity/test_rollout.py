"""Whole episodes in compiled code equal those that Python steps through flatland-rl, to the bit."""

import numpy as np
import pytest

from common.config import DIFFICULTIES, NetworkConfig
from common.levels.supply import LevelSupply
from common.policy.compiled import Twin
from common.policy.networks import build_network, export_parameters
from common.policy.player import MAX_TRAINS, network_layout, player
from common.policy.rollout import Rollouts

FIELDS = ("observations", "times", "trains", "actions", "rewards", "arrived_at", "final_observations")


def twin_of(config, seed):
    twin = Twin(network_layout(config))
    twin.load(export_parameters(build_network(config, 252, 5, seed)))
    return twin


def same(ours, theirs):
    return all(np.array_equal(np.array(getattr(ours, name)), np.array(getattr(theirs, name))) for name in FIELDS)


@pytest.mark.parametrize("epsilon", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_both_engines_play_the_same_episode(difficulty, epsilon):
    twin = twin_of(NetworkConfig(kind="dueling" if epsilon > 0 else "plain"), seed=3)
    compiled = player("compiled", MAX_TRAINS, lambda: None)
    flatland = player("flatland", MAX_TRAINS, lambda: None)
    for seed in range(3):
        level = LevelSupply().training(difficulty, seed)
        assert same(compiled(level, twin, epsilon, 77), flatland(level, twin, epsilon, 77))


def test_an_episode_does_not_depend_on_those_before_it():
    twin = twin_of(NetworkConfig(kind="dueling"), seed=4)
    levels = [LevelSupply().training(name, 5) for name in ("hard", "easy", "medium")]
    one = Rollouts(MAX_TRAINS)
    in_turn = [one.play(level, twin, 0.5, 9) for level in levels]
    for level, recording in zip(levels, in_turn, strict=True):
        assert same(recording, Rollouts(MAX_TRAINS).play(level, twin, 0.5, 9))
