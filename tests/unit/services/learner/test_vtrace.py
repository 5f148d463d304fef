"""V-trace worked by hand, and its targets on the policy's own decisions, which are their returns."""

import numpy as np
import pytest
from made_episodes import course_of, decisions_of, make_episode

from railctl.services.learner.returns import decision_returns
from railctl.services.learner.vtrace import clipped_ratios, vtrace_targets


def targets(rewards, arrived_at, decided, values, ratios, final=(0.0,), discount=0.5):
    """Of one or more trains' decisions: (time, train)."""
    course = course_of(rewards, arrived_at, decisions_of(((*when, 0, [0]) for when in decided), 1))
    values, ratios = np.array(values, np.float32), np.array(ratios, np.float64)
    return vtrace_targets(course, np.array(final, np.float32), discount, values, ratios)


def test_ratios_are_those_of_the_probabilities_and_at_most_one():
    now, then = np.log(np.array([[0.1, 0.5, 0.9, 1.0], [0.2, 0.5, 0.3, 1.0]], np.float32))
    np.testing.assert_allclose(clipped_ratios(now, then), [0.5, 1.0, 1.0, 1.0], rtol=1e-6)


def test_a_probability_that_has_become_much_larger_makes_no_warning():
    with np.errstate(all="raise"):
        assert clipped_ratios(np.array([0], np.float32), np.array([-900], np.float32)) == [1.0]


def test_three_decisions_by_hand():
    # Discount 1/2 and rewards of -1, scaled by 1/2: each step costs 1/2; after the last step the critic says -0.8.
    # v_2 = -0.9: -1/2 - 0.8/2, and the policy has not changed.
    # v_1 = half of its value -0.6 and half of -1/2 - 0.9/2 = -0.95: -0.775.
    # v_0 = 3/4 of its value -0.4 and 1/4 of -1/2 - 0.775/2 = -0.8875: -0.521875.
    got = targets([[-1], [-1], [-1]], [-1], [(0, 0), (1, 0), (2, 0)], [-0.4, -0.6, -0.7], [0.25, 0.5, 1.0], [-0.8])
    np.testing.assert_allclose(got, [-0.521875, -0.775, -0.9], rtol=1e-6)


def test_the_sum_of_the_paper_comes_to_the_same():
    # Equation 1 for the decisions above: v_0 = V_0 + rho_0 d_0 + g c_0 rho_1 d_1 + g^2 c_0 c_1 rho_2 d_2, g = 1/2.
    values, rho = [-0.4, -0.6, -0.7, -0.8], [0.25, 0.5, 1.0]
    d = [-0.5 + 0.5 * values[k + 1] - values[k] for k in range(3)]
    paper = values[0] + rho[0] * d[0] + 0.5 * rho[0] * rho[1] * d[1] + 0.25 * rho[0] * rho[1] * rho[2] * d[2]
    got = targets([[-1], [-1], [-1]], [-1], [(0, 0), (1, 0), (2, 0)], values[:3], rho, values[3:])
    assert got[0] == pytest.approx(paper, rel=1e-6)
    # And the advantage of its policy gradient, rho_0 (r + g v_1 - V_0), is the target less the value.
    assert got[0] - values[0] == pytest.approx(rho[0] * (-0.5 + 0.5 * got[1] - values[0]), rel=1e-5)


def test_what_is_on_the_way_to_the_next_decision_is_discounted_by_each_step():
    # From step 2, where the train decides again and arrives: its value -0.2, for it would not do so any more.
    # From step 0 the way there costs 1/2 + 1/4, and the rest is worth a quarter of -0.2: -0.8.
    got = targets([[-1], [-1], [0]], [2], [(0, 0), (2, 0)], [-0.3, -0.2], [1.0, 0.0], [-9])
    np.testing.assert_allclose(got, [-0.8, -0.2], rtol=1e-6)


def test_trains_are_each_for_themselves():
    got = targets([[-1, -1], [-1, -1]], [-1, -1], [(0, 0), (0, 1), (1, 1)], [-0.1, -0.2, -0.3], [1, 0, 0.5], [-1, -0.4])
    # Train 0: -1/2 - 1/4 - 1/4. Train 1 on step 1: half of -0.3 and half of -1/2 - 0.2; its step 0 counts as its value.
    np.testing.assert_allclose(got, [-1.0, -0.2, -0.5], rtol=1e-6)


@pytest.mark.parametrize("number", range(4))
def test_if_the_policy_acted_itself_targets_are_returns_to_the_bit(number):
    course = make_episode(number).course
    final = -np.random.default_rng(number).random(course.n_trains).astype(np.float32)
    count = len(course.decisions)
    values = np.random.default_rng(number).random(count, np.float32)
    got = vtrace_targets(course, final, 0.97, values, np.ones(count))
    assert got.tobytes() == decision_returns(course, final, 0.97).tobytes()


@pytest.mark.parametrize("number", range(4))
def test_if_the_policy_would_do_nothing_of_it_targets_are_values(number):
    course = make_episode(number).course
    values = np.random.default_rng(number).random(len(course.decisions)).astype(np.float32)
    got = vtrace_targets(course, np.zeros(course.n_trains, np.float32), 0.97, values, np.zeros(len(values)))
    assert got.tobytes() == values.tobytes()
