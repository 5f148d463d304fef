"""Choices by the rules of `acting`, and softmax's probabilities."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from railctl.common.policy import choosing
from railctl.common.policy.acting import EpsilonGreedy
from railctl.common.policy.packing import ACTOR_CRITIC
from railctl.common.seeding import stream_key

KEY = stream_key(1, 2, "explore")
LOGITS = np.array([0.5, -1.0, 2.0, 0.0], np.float32)


@pytest.mark.parametrize(("values", "action"), [((1, 2, 3), 2), ((3, 3, 1), 0), ((1, 3, 3), 1), ((0, 0, 0), 0)])
def test_the_best_is_the_lowest_of_equals(values, action):
    assert choosing.best(np.array(values, np.float32), 15) == action
    assert choosing.best.py_func(np.array(values, np.float32), 15) == action


@pytest.mark.parametrize(("allowed", "action"), [(0b0111, 0), (0b0110, 1), (0b0100, 2), (0b1000, 3)])
def test_the_best_is_among_those_allowed(allowed, action):
    assert choosing.best(np.array([5, 4, 4, 9], np.float32), allowed) == action


@pytest.mark.parametrize("allowed", [0b1111, 0b1010, 0b0100])
@pytest.mark.parametrize("epsilon", [0.0, 0.3, 1.0])
def test_epsilon_greedy_is_that_of_acting(epsilon, allowed):
    values = np.array([1, 5, 5, 2], np.float32)
    policy = EpsilonGreedy(1, 4)
    policy.values = lambda _network, _observation: values
    for counter in range(0, 400, 2):
        expected = policy.act(None, np.zeros(1, np.float32), epsilon, KEY, counter, allowed)
        assert choosing.epsilon_greedy(values, allowed, epsilon, np.uint64(KEY), np.uint64(counter)) == expected


def test_random_actions_are_any_of_those_allowed_with_the_same_chance():
    values, n = np.zeros(4, np.float32), 3000
    actions = [choosing.epsilon_greedy(values, 0b1101, 1.0, np.uint64(KEY), np.uint64(2 * i)) for i in range(n)]
    shares = np.bincount(actions, minlength=4) / n
    assert shares[1] == 0
    assert (np.abs(shares[[0, 2, 3]] - 1 / 3) < 0.04).all()


@settings(deadline=None)
@given(npst.arrays(np.float32, 5, elements=st.floats(-30, 30, width=32)), st.integers(1, 31), st.integers(0, 2**31))
def test_what_is_not_allowed_is_as_if_the_network_did_not_have_it(scores, allowed, counter):
    actions = [action for action in range(5) if allowed >> action & 1]
    few, everything = scores[actions].copy(), (1 << len(actions)) - 1
    draws = np.uint64(KEY), np.uint64(counter)
    assert choosing.best(scores, allowed) == actions[choosing.best(few, everything)]
    for epsilon in (0.0, 0.5, 1.0):
        chosen = choosing.epsilon_greedy(few, everything, epsilon, *draws)
        assert choosing.epsilon_greedy(scores, allowed, epsilon, *draws) == actions[chosen]
    chosen = choosing.softmax_sample(few, everything, *draws)
    assert choosing.softmax_sample(scores, allowed, *draws) == actions[chosen]
    expected = choosing.log_probability(few, everything, chosen)
    assert choosing.log_probability(scores, allowed, actions[chosen]) == expected


def masked(allowed):
    """Logits that torch makes zeros of where an action is not allowed."""
    return torch.tensor([logit if allowed >> action & 1 else -np.inf for action, logit in enumerate(LOGITS.tolist())])


@pytest.mark.parametrize("allowed", [0b1111, 0b1011])
def test_samples_follow_softmax(allowed):
    n = 20_000
    actions = [choosing.softmax_sample(LOGITS, allowed, np.uint64(KEY), np.uint64(2 * i)) for i in range(n)]
    shares = np.bincount(actions, minlength=4) / n
    expected = torch.softmax(masked(allowed), 0).numpy()
    assert shares[expected == 0].tolist() == [0] * (4 - allowed.bit_count())
    assert (np.abs(shares - expected) <= 4.5 * np.sqrt(expected * (1 - expected) / n)).all()


def test_a_sample_depends_on_its_counter_alone():
    def sample(counter: int) -> int:
        return choosing.softmax_sample(LOGITS, 15, np.uint64(KEY), np.uint64(counter))

    forwards = [sample(counter) for counter in range(0, 100, 2)]
    assert forwards == [sample(counter) for counter in range(98, -1, -2)][::-1]
    assert forwards == [
        choosing.softmax_sample.py_func(LOGITS, 15, np.uint64(KEY), np.uint64(counter)) for counter in range(0, 100, 2)
    ]


def test_a_certain_action_is_always_taken():
    logits = np.array([-200, 300, -200], np.float32)
    assert {choosing.softmax_sample(logits, 15, np.uint64(KEY), np.uint64(i)) for i in range(200)} == {1}


@pytest.mark.parametrize(("allowed", "actions"), [(0b1111, [0, 1, 2, 3]), (0b1010, [1, 3]), (0b0010, [1])])
def test_log_probabilities_are_those_of_torch(allowed, actions):
    expected = torch.log_softmax(masked(allowed).double(), 0).numpy()[actions]
    got = [choosing.log_probability(LOGITS, allowed, action) for action in actions]
    np.testing.assert_allclose(got, expected, rtol=1e-12)


POLICY, VALUES = (np.array([kind, 0, 4], np.int64) for kind in (ACTOR_CRITIC, 0))


def chosen(header, label, epsilon, allowed=0b1111, *, greedy=False, count=2000):
    told = header, LOGITS, allowed, label, greedy, epsilon, np.uint64(KEY)
    return [choosing.choose(*told, np.uint64(2 * i)) for i in range(count)]


def test_a_policy_does_as_its_teacher_would_as_often_as_it_shall():
    own = chosen(POLICY, choosing.NOTHING, 0.5)
    assert own == chosen(POLICY, 1, 0.0)
    assert chosen(POLICY, 1, 1.0) == [1] * len(own)
    some = chosen(POLICY, 1, 0.5)
    assert abs(np.mean([ours != theirs for ours, theirs in zip(own, some, strict=True)]) - 0.5) < 0.05
    assert all(theirs in (ours, 1) for ours, theirs in zip(own, some, strict=True))


def test_a_teacher_is_not_heard_where_that_is_not_allowed_or_the_best_is_taken():
    assert chosen(POLICY, 1, 1.0, 0b1101) == chosen(POLICY, choosing.NOTHING, 0.0, 0b1101)
    assert set(chosen(POLICY, 1, 1.0, greedy=True)) == {2}
    assert chosen(VALUES, 1, 0.0) == chosen(VALUES, choosing.NOTHING, 0.0)
