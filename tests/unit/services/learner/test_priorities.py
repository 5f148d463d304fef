"""The tree of sums against plain sums, and the paper's formulas by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.services.learner.replay.priorities import ADDED_TO_PRIORITY, Priorities, find, update, weigh

ODD_SIZES = (0.0, 5e-324, 1e-300, 1e-6, 1.0, 1e150)


def tree_of(leaves):
    """A tree with these leaves, the sums added up from below."""
    size = 1 << (len(leaves) - 1).bit_length()
    tree = np.zeros(2 * size)
    tree[size : size + len(leaves)] = leaves
    for node in range(size - 1, 0, -1):
        tree[node] = tree[2 * node] + tree[2 * node + 1]
    return tree


def found(leaves, draws, beta=1.0):
    tree, points = tree_of(leaves), np.array(draws, np.float64)
    places, weights = np.empty(len(draws), np.int64), np.empty(len(draws), np.float32)
    find(tree, points, places)
    weigh(tree, places, beta, points, weights)
    assert points.tolist() == [leaves[place] for place in places]
    return places, weights


def test_each_stratum_is_found_by_hand():
    places, weights = found([1, 0, 2, 1], [0, 0.5, 0.75, 0])  # at 0, 1.5, 2.75 and 3 of 4
    assert places.tolist() == [0, 2, 2, 3]
    assert weights.tolist() == [1, 0.5, 0.5, 1]


def test_importance_weights_by_hand():
    # P = 1/10 and 9/10 of N = 2 items: (1/(N P))^0.5 = sqrt(5) and sqrt(5/9), divided by the largest
    _, weights = found([1, 9], [0, 0], beta=0.5)
    assert weights.tolist() == pytest.approx([1, 1 / 3])
    assert found([1, 9], [0, 0], beta=0.0)[1].tolist() == [1, 1]
    assert found([1, 9], [0.5, 0.5])[1].tolist() == [1, 1]  # the largest of the batch, not of all items


def test_a_draw_that_equals_or_exceeds_the_total_finds_the_last_that_is_not_zero():
    assert found([1, 2, 3, 0, 0], [1.0])[0].tolist() == [2]
    assert found([1, 2, 3, 0, 0], [1.5])[0].tolist() == [2]
    assert found([0, 0, 7], [1.0])[0].tolist() == [2]
    assert found([4], [1.0])[0].tolist() == [0]


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 5), min_size=1, max_size=20).filter(any),
    st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=9),
)
def test_the_search_is_one_of_prefix_sums(leaves, draws):
    size = len(draws)  # whole numbers, so that all differences are exact
    points = [(i + draw) / size * sum(leaves) for i, draw in enumerate(draws)]
    last = max(i for i, leaf in enumerate(leaves) if leaf)
    expected = np.minimum(np.searchsorted(np.cumsum(leaves), points, side="right"), last)
    assert found(leaves, draws)[0].tolist() == expected.tolist()


@settings(deadline=None)
@given(
    st.lists(st.sampled_from(ODD_SIZES), min_size=1, max_size=20).filter(any),
    st.lists(st.sampled_from([0.0, 5e-324, 0.5, 1 - 2**-53, 1.0]), min_size=1, max_size=9),
)
def test_what_is_zero_is_never_found_beside_what_is_not(leaves, draws):
    places, weights = found(leaves, draws)
    assert all(leaves[place] > 0 for place in places)
    assert ((weights >= 0) & (weights <= 1)).all()
    assert weights.max() == 1


@settings(deadline=None)
@given(st.integers(1, 20), st.data())
def test_updates_are_those_of_a_list(capacity, data):
    priorities, naive, largest = Priorities(capacity, alpha=0.5), [0.0] * capacity, 1.0
    place = st.integers(0, capacity - 1)
    priority = st.none() | st.floats(0, 1e6)
    for batch in data.draw(st.lists(st.lists(st.tuples(place, priority), max_size=8), max_size=5)):
        plain = [(p, q) for p, q in batch if q is not None]
        new = [p for p, q in batch if q is None]
        priorities.put(np.array([p for p, _ in plain], np.int64), np.array([q for _, q in plain], np.float64))
        for p, q in plain:  # the last one counts
            naive[p], largest = (q + ADDED_TO_PRIORITY) ** 0.5, max(largest, q)
        priorities.put(np.array(new, np.int64), None)
        for p in new:
            naive[p] = (largest + ADDED_TO_PRIORITY) ** 0.5
    state = priorities.state(capacity)
    np.testing.assert_allclose(state["priorities"], naive, rtol=1e-14)
    assert state["priority_maximum"] == largest
    np.testing.assert_array_equal(priorities.tree, tree_of(state["priorities"]))  # no drift, to the bit
    other = Priorities(capacity, alpha=0.5)
    other.put(np.arange(capacity), np.full(capacity, 7.0))  # what was there before must not matter
    other.restore(state["priorities"], float(state["priority_maximum"]), 0.5)
    np.testing.assert_array_equal(other.tree, priorities.tree)
    assert (other.largest, other.total) == (priorities.largest, priorities.total)


@settings(deadline=None)
@given(st.lists(st.floats(0, 1e6), min_size=1, max_size=20), st.lists(st.floats(0.1, 1), min_size=1, max_size=5))
def test_a_falling_alpha_raises_what_is_there(given_priorities, alphas):
    capacity, alphas = len(given_priorities) + 1, sorted(alphas, reverse=True)
    priorities = Priorities(capacity, alphas[0])
    priorities.put(np.arange(capacity - 1), np.array(given_priorities))
    for alpha in alphas:
        priorities.temper(alpha)
    expected = [*((p + ADDED_TO_PRIORITY) ** alphas[-1] for p in given_priorities), 0]
    state = priorities.state(capacity)
    np.testing.assert_allclose(state["priorities"], expected, rtol=1e-12)
    np.testing.assert_array_equal(priorities.tree, tree_of(state["priorities"]))
    other = Priorities(capacity, alphas[0])
    other.restore(state["priorities"], float(state["priority_maximum"]), alphas[-1])
    for each in (priorities, other):
        each.temper(0.05)
        each.put(np.array([0]), np.array([3.0]))
    np.testing.assert_array_equal(other.tree, priorities.tree)


def test_alpha_by_hand():
    priorities = Priorities(3, alpha=0.5)
    priorities.put(np.array([0, 1]), np.array([4.0, 9.0]))
    assert priorities.state(3)["priorities"].tolist() == pytest.approx([2, 3, 0], rel=1e-6)
    assert priorities.total == pytest.approx(5, rel=1e-6)
    priorities.put(np.array([2]), None)
    assert priorities.state(3)["priorities"][2] == priorities.largest == pytest.approx(3, rel=1e-6)
    priorities.put(np.array([0]), np.array([0.0]))
    assert priorities.state(1)["priorities"].tolist() == pytest.approx([math.sqrt(ADDED_TO_PRIORITY)])


def test_draws_are_proportional_and_spread_over_strata():
    priorities = Priorities(5, alpha=1.0)
    priorities.put(np.arange(4), np.array([1.0, 2, 3, 4]))
    draws, places, weights = np.random.default_rng(1).random(1000), np.empty(1000, np.int64), np.empty(1000, np.float32)
    find(priorities.tree, draws, places)
    weigh(priorities.tree, places, 1.0, draws, weights)
    counts = np.bincount(places, minlength=5)
    assert (abs(counts - [100, 200, 300, 400, 0]) <= 2).all()  # independent draws would stray by ten times as much
    assert (np.diff(places) >= 0).all()
    np.testing.assert_allclose(weights, 1 / (places + 1), rtol=1e-5)


@pytest.mark.parametrize("wrong", [-1e-9, math.nan, math.inf])
def test_a_priority_that_cannot_be_changes_nothing(wrong):
    priorities = Priorities(3, alpha=0.5)
    before = priorities.tree.copy()
    with pytest.raises(ValueError, match="finite and at least 0"):
        priorities.put(np.array([0, 1]), np.array([1.0, wrong]))
    with pytest.raises(ValueError, match="2 items need as many"):
        priorities.put(np.array([0, 1]), np.ones(3))
    np.testing.assert_array_equal(priorities.tree, before)
    assert priorities.state(0)["priority_maximum"] == 1


@pytest.mark.parametrize("place", [-1, 3])
def test_a_place_that_does_not_exist_is_refused(place):
    priorities = Priorities(3, alpha=0.5)  # the tree has a fourth leaf, which is nobody's
    with pytest.raises(ValueError, match="one of the replay"):
        priorities.put(np.array([place]), np.array([1.0]))
    assert update(np.zeros(8), np.array([place]), np.array([1.0]), 3, 0.5) == -1
