"""Scores are those of the levels, and sampling is a function of (seed, number of the level)."""

import numpy as np
import pytest
from made_episodes import course_of, decisions_of

from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.player import Acting, play, player
from railctl.common.rules.settings import NetworkConfig
from railctl.common.world import study_world
from railctl.services.evaluator.runner import UnplayableLevelError, evaluate, greedy, sampled

LEVELS = [LevelSupply().evaluation("easy", index) for index in range(4)]


def study_player(engine, trains=7, **options):
    """What plays the study's levels."""
    return player(engine, study_world(), "legacy", trains, **options)


def course(level, rewards, arrived_at, score=None):
    """An episode of three trains without any decisions."""
    return course_of(rewards, arrived_at, decisions_of([], 1), max_steps=level.max_steps, score=score)


def test_a_score_worked_by_hand():
    played = {
        0: course(LEVELS[0], [[-5, 0, -1], [2, 1, 1]], [1, 0, 1], score=0.5),  # (-(1 + 0 + 1) + 3) / (3 * 412)
        1: course(LEVELS[1], [[-1, -1, -1]] * 412, [-1, 7, -1], score=0.25),  # -(412 + 7 + 412) / (3 * 412)
    }
    told = []
    score = evaluate(lambda index, _level: played[index], LEVELS[:2], told.append)
    assert score.returns.tolist() == [1 / 1236, -831 / 1236]
    assert score.arrived_shares.tolist() == [1.0, pytest.approx(1 / 3)]
    assert score.all_arrived.tolist() == [True, False]
    assert score.steps.tolist() == [2, 412]
    assert (score.mean_return, score.all_arrived_share, score.mean_steps) == (pytest.approx(-415 / 1236), 0.5, 207.0)
    assert score.mean_score == 0.375
    assert score.arrived_share == pytest.approx(2 / 3)
    assert told == [1, 2]


def test_a_level_that_cannot_be_played_is_named():
    with pytest.raises(UnplayableLevelError, match=r"^level 0: the level has 3 trains, the world has room for 2$"):
        evaluate(lambda _, level: study_player("compiled", 2).begin(level), LEVELS)


@pytest.fixture(scope="module")
def twin(write_checkpoint, tmp_path_factory):
    path = tmp_path_factory.mktemp("policy") / "weights.safetensors"
    return load_policy(write_checkpoint(path, NetworkConfig(kind="actor-critic"), seed=1)).network


def test_greedy_play_takes_the_best_and_the_room_for_trains_changes_nothing(twin):
    expected = [
        play(study_player("flatland", 3), level, Acting(twin, greedy=True)).normalised_return for level in LEVELS
    ]
    assert len(set(expected)) > 2
    assert evaluate(greedy(study_player("compiled", 3), twin), LEVELS).returns.tolist() == expected
    assert evaluate(greedy(study_player("compiled", 40), twin), LEVELS).returns.tolist() == expected


def test_samples_are_those_of_seed_and_number(twin):
    together = [
        sampled(study_player("compiled", 3), twin, 5)(index, level).decisions.actions
        for index, level in enumerate(LEVELS)
    ]
    policy = sampled(study_player("compiled", 3), twin, 5)
    for index in (3, 0):  # in another order, without the others
        np.testing.assert_array_equal(policy(index, LEVELS[index]).decisions.actions, together[index])
    for other in (policy(1, LEVELS[0]), sampled(study_player("compiled", 3), twin, 6)(0, LEVELS[0])):
        assert other.decisions.actions.tolist() != together[0].tolist()
    assert greedy(study_player("compiled", 3), twin)(0, LEVELS[0]).decisions.actions.tolist() != together[0].tolist()
