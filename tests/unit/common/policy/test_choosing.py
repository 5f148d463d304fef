"""Choices by the rules of `acting`, and softmax's probabilities."""

import numpy as np
import pytest
import torch

from common.policy import choosing
from common.policy.acting import EpsilonGreedy
from common.seeding import stream_key

KEY = stream_key(1, 2, "explore")
LOGITS = np.array([0.5, -1.0, 2.0, 0.0], np.float32)


@pytest.mark.parametrize(("values", "action"), [((1, 2, 3), 2), ((3, 3, 1), 0), ((1, 3, 3), 1), ((0, 0, 0), 0)])
def test_the_best_is_the_lowest_of_equals(values, action):
    assert choosing.best(np.array(values, np.float32)) == action
    assert choosing.best.py_func(np.array(values, np.float32)) == action


@pytest.mark.parametrize("epsilon", [0.0, 0.3, 1.0])
def test_epsilon_greedy_is_that_of_acting(epsilon):
    values = np.array([1, 5, 5, 2], np.float32)
    policy = EpsilonGreedy(1, 4)
    policy.values = lambda _network, _observation: values
    for counter in range(0, 400, 2):
        expected = policy.act(None, np.zeros(1, np.float32), epsilon, KEY, counter)
        assert choosing.epsilon_greedy(values, epsilon, np.uint64(KEY), np.uint64(counter)) == expected


def test_samples_follow_softmax():
    n = 20_000
    actions = [choosing.softmax_sample(LOGITS, np.uint64(KEY), np.uint64(2 * i)) for i in range(n)]
    shares = np.bincount(actions, minlength=4) / n
    expected = torch.softmax(torch.tensor(LOGITS), 0).numpy()
    assert (np.abs(shares - expected) < 4.5 * np.sqrt(expected * (1 - expected) / n)).all()


def test_a_sample_depends_on_its_counter_alone():
    def sample(counter: int) -> int:
        return choosing.softmax_sample(LOGITS, np.uint64(KEY), np.uint64(counter))

    forwards = [sample(counter) for counter in range(0, 100, 2)]
    assert forwards == [sample(counter) for counter in range(98, -1, -2)][::-1]
    assert forwards == [
        choosing.softmax_sample.py_func(LOGITS, np.uint64(KEY), np.uint64(counter)) for counter in range(0, 100, 2)
    ]


def test_a_certain_action_is_always_taken():
    logits = np.array([-200, 300, -200], np.float32)
    assert {choosing.softmax_sample(logits, np.uint64(KEY), np.uint64(i)) for i in range(200)} == {1}


def test_log_probabilities_are_those_of_torch():
    expected = torch.log_softmax(torch.tensor(LOGITS, dtype=torch.float64), 0).numpy()
    got = [choosing.log_probability(LOGITS, action) for action in range(4)]
    np.testing.assert_allclose(got, expected, rtol=1e-12)
