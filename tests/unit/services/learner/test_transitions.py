"""Transitions of hand-made episodes."""

import numpy as np
import pytest

from common.records import Episode
from services.learner.replay.transitions import transitions


def make_episode(decisions, rewards, arrived_at, final):
    """An episode of one feature; `decisions` are (time, train, action, feature)."""
    times, trains, actions, features = zip(*decisions, strict=True) if decisions else ((), (), (), ())
    return Episode(
        episode=3,
        fragment=0,
        first_step=0,
        over=True,
        level="easy",
        level_seed=1,
        level_hash="0" * 32,
        weights_version=3,
        actor="a",
        acting_s=0.0,
        waited_s=0.0,
        max_steps=len(rewards),
        observations=np.array(features, np.float32).reshape(-1, 1),
        times=np.array(times, np.int32),
        trains=np.array(trains, np.int32),
        actions=np.array(actions, np.int8),
        log_probabilities=np.zeros(len(times), np.float32),
        values=np.zeros(len(times), np.float32),
        rewards=np.array(rewards, np.float32),
        arrived_at=np.array(arrived_at, np.int32),
        final_observations=np.array(final, np.float32).reshape(-1, 1),
        states=np.zeros((len(arrived_at), 0), np.float32),
    )


def test_one_train_arrives_and_one_is_truncated():
    result = transitions(
        make_episode(
            decisions=[(0, 0, 2, 0.1), (1, 1, 3, 0.2), (2, 0, 4, 0.3)],
            rewards=[[-1, -10], [-2, -20], [-3, -30], [7, -40]],
            arrived_at=[2, -1],
            final=[0.0, 0.9],
        ),
        discount=0.5,
    )
    assert len(result) == 3
    assert result.completed_at.tolist() == [2, 3, 4]
    assert result.action_tm1.tolist() == [2, 4, 3]
    np.testing.assert_array_equal(result.observation_tm1, np.float32([[0.1], [0.3], [0.2]]))
    # -1 - 2/2;  -3 and not the 7 after the arrival;  -20 - 30/2 - 40/4
    assert result.reward_t.tolist() == [-2, -3, -45]
    assert result.discount_t.tolist() == [0.25, 0, 0.125]
    np.testing.assert_array_equal(result.observation_t, np.float32([[0.3], [0], [0.9]]))


def test_what_completes_together_is_in_the_order_of_trains():
    result = transitions(
        make_episode(
            decisions=[(0, 2, 2, 0.1), (1, 0, 0, 0.2), (2, 0, 1, 0.3), (2, 2, 3, 0.4)],
            rewards=np.full((3, 3), -1),
            arrived_at=[-1, 1, 2],  # train 1 never decides
            final=[0.8, 0.0, 0.0],
        ),
        discount=1.0,
    )
    assert result.completed_at.tolist() == [2, 2, 3, 3]
    assert result.action_tm1.tolist() == [0, 2, 1, 3]
    assert result.reward_t.tolist() == [-1, -2, -1, -1]
    assert result.discount_t.tolist() == [1, 1, 1, 0]


def test_the_bonus_reaches_the_trains_that_arrive_last():
    result = transitions(
        make_episode(
            decisions=[(0, 0, 2, 0.1), (0, 1, 2, 0.2), (1, 1, 2, 0.3), (1, 2, 2, 0.4)],
            rewards=[[-1, -1, -1], [1, 1, 1]],
            arrived_at=[0, 1, 1],
            final=[0, 0, 0],
        ),
        discount=0.5,
    )
    assert result.reward_t.tolist() == [-1, -1, 1, 1]
    assert result.discount_t.tolist() == [0, 0.5, 0, 0]


def test_sums_run_in_double_precision():
    rewards = np.full((5000, 1), -0.1, np.float32)
    result = transitions(make_episode([(0, 0, 2, 0.1)], rewards, [-1], [0.5]), discount=1.0)
    assert result.reward_t[0] == np.float32(5000 * np.float64(np.float32(-0.1)))


def test_an_episode_without_decisions_has_no_transitions():
    result = transitions(make_episode([], [[-1, -1]], [-1, 0], [0.5, 0]), discount=0.99)
    assert len(result) == 0
    assert result.observation_t.shape == (0, 1)


@pytest.mark.parametrize(
    ("decisions", "message"),
    [
        ([(1, 0, 2, 0.1), (0, 0, 2, 0.1)], "episode 3: decisions are not in the order"),
        ([(0, 1, 2, 0.1), (0, 0, 2, 0.1)], "episode 3: decisions are not in the order"),
        ([(0, 0, 2, 0.1), (0, 0, 2, 0.1)], "episode 3: decisions are not in the order"),
        ([(2, 0, 2, 0.1)], "episode 3: a train decides after its arrival"),
    ],
)
def test_decisions_that_cannot_be_are_refused(decisions, message):
    with pytest.raises(ValueError, match=message):
        transitions(make_episode(decisions, -np.ones((3, 2)), [1, -1], [0, 0]), discount=0.99)


def test_a_part_is_a_slice_of_every_field():
    whole = transitions(make_episode([(0, 0, 2, 0.1), (1, 0, 3, 0.2)], [[-1], [-2]], [-1], [0.5]), discount=0.5)
    part = whole[1:]
    assert (len(part), part.action_tm1.tolist(), part.reward_t.tolist()) == (1, [3], [-2])
    assert part.completed_at.tolist() == [2]
