"""Returns worked by hand: who arrives, who is stopped by the limit, and who gets the last reward."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_episodes import course_of, decisions_of

from railctl.services.learner.returns import decision_returns


def returns(rewards, arrived_at, final_values, discount=0.5):
    """From every step on, as if all trains decided on all steps."""
    rewards = np.array(rewards, np.float32)
    times, trains = np.nonzero(np.ones_like(rewards))
    decisions = decisions_of(((time, train, 0, [0]) for time, train in zip(times, trains, strict=True)), 1)
    course = course_of(rewards, arrived_at, decisions)
    return decision_returns(course, np.array(final_values, np.float32), discount).reshape(rewards.shape)


def test_a_train_that_the_limit_stopped_is_worth_what_it_saw_last():
    # Scaled by 1/2: -0.5 a step, then half of what follows. From -0.8: -0.9, -0.95, -0.975.
    np.testing.assert_allclose(returns([[-1], [-1], [-1]], [-1], [-0.8])[:, 0], [-0.975, -0.95, -0.9], rtol=1e-6)


def test_a_train_that_arrived_is_worth_nothing_after():
    np.testing.assert_allclose(returns([[-1], [-1], [0]], [1], [-0.8])[:, 0], [-0.75, -0.5, 0], rtol=1e-6)


def test_the_least_of_a_cost_of_one_a_step_is_to_pay_it_for_ever():
    np.testing.assert_allclose(returns([[-1], [-1], [-1]], [-1], [-1])[:, 0], [-1, -1, -1])


def test_the_reward_for_all_having_arrived_counts_for_those_that_arrived_before():
    # Train 0 arrives on step 0, train 1 on step 2, on which everyone gets 1 more.
    got = returns([[0, -1], [0, -1], [1, 1]], [0, 2], [9, 9])
    np.testing.assert_allclose(got[:, 0], [0.125, 0.25, 0.5], rtol=1e-6)
    np.testing.assert_allclose(got[:, 1], [-0.625, -0.25, 0.5], rtol=1e-6)


@given(
    steps=st.integers(1, 60),
    discount=st.floats(0.01, 0.999),
    value=st.floats(-1, 0, width=32),
)
def test_steps_that_cost_one_never_leave_the_range_of_values(steps, discount, value):
    got = returns(-np.ones((steps, 1)), [-1], [value], discount)
    assert (got >= -1 - 1e-6).all()
    assert (got <= 0).all()
    closed = -1 + (1 + value) * discount ** (steps - np.arange(steps))
    np.testing.assert_allclose(got[:, 0], closed, atol=1e-6)


def test_returns_are_single_numbers_from_sums_in_double():
    got = returns(-np.ones((400, 1)), [399], [0], 0.99)
    assert got.dtype == np.float32
    assert got[0, 0] == pytest.approx(-(1 - 0.99**400), rel=1e-7)
