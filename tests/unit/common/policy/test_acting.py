"""Greedy and exploring choices, and their independence of everything but their own draws."""

from collections import Counter

import numpy as np
import pytest

from railctl.common.policy.acting import EpsilonGreedy, draw_counter
from railctl.common.policy.networks import build_network, import_parameters
from railctl.common.rules.settings import NetworkConfig
from railctl.common.seeding import stream_key, uniform

KEY = stream_key(1, 2, "explore")


@pytest.fixture
def network():
    """Three actions; the values of observation (x,) are (x, 1, 1) for x >= 0."""
    network = build_network(NetworkConfig(hidden=(1,)), n_features=1, n_actions=3, seed=0)
    import_parameters(
        network,
        {
            "hidden.0.weight": np.array([[1]], np.float32),
            "hidden.0.bias": np.array([0], np.float32),
            "q.weight": np.array([[1], [0], [0]], np.float32),
            "q.bias": np.array([0, 1, 1], np.float32),
        },
    )
    return network


@pytest.mark.parametrize(("x", "action"), [(2.0, 0), (1.0, 0), (0.5, 1)])
def test_greedy_takes_the_best_and_of_equals_the_lowest(network, x, action):
    assert EpsilonGreedy(1, 3).act(network, np.array([x], np.float32), 0.0, KEY, 0) == action


def test_values_are_those_of_the_network(network):
    assert EpsilonGreedy(1, 3).values(network, np.array([4], np.float32)).tolist() == [4, 1, 1]


def test_exploration_uses_the_two_draws_of_its_counter(network):
    policy = EpsilonGreedy(1, 3)
    observation = np.array([2], np.float32)
    for counter in range(0, 200, 2):
        explores = uniform(KEY, counter) < 0.5
        expected = int(3 * uniform(KEY, counter + 1)) if explores else 0
        assert policy.act(network, observation, 0.5, KEY, counter) == expected


def test_full_exploration_is_uniform(network):
    policy = EpsilonGreedy(1, 3)
    observation = np.array([2], np.float32)
    counts = Counter(policy.act(network, observation, 1.0, KEY, 2 * i) for i in range(3000))
    assert sorted(counts) == [0, 1, 2]
    assert all(abs(count - 1000) < 120 for count in counts.values())  # more than four standard deviations


def test_every_decision_of_an_episode_has_draws_of_its_own():
    counters = [draw_counter(step, 3, train) for step in range(10) for train in range(3)]
    assert [draw for counter in counters for draw in (counter, counter + 1)] == list(range(60))


def test_in_an_episode_step_and_train_give_the_counter(network):
    policy = EpsilonGreedy(1, 3)
    observation = np.array([2], np.float32)
    choose = policy.in_episode(network, 0.9, KEY, n_trains=3)
    for step in range(20):
        for train in range(3):
            expected = policy.act(network, observation, 0.9, KEY, draw_counter(step, 3, train))
            assert choose(observation, step, train) == expected


def test_a_choice_depends_neither_on_memory_nor_on_earlier_choices():
    network = build_network(NetworkConfig(), n_features=252, n_actions=5, seed=3)
    rng = np.random.default_rng(0)
    observations = -rng.random((20, 252), np.float32)
    alone = [EpsilonGreedy(252, 5).values(network, row.copy()).tobytes() for row in observations]
    policy = EpsilonGreedy(252, 5)
    raw = np.zeros(252 * 4 + 1, np.uint8)[1:].view(np.float32)  # at an odd address
    for row, expected in zip(observations[::-1], alone[::-1], strict=True):
        raw[:] = row
        assert policy.values(network, raw).tobytes() == expected
