"""Transitions of hand-made episodes, whole and cut into fragments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_episodes import STEPS, cut, decided, edited, make_episode, with_following

from railctl.services.learner.replay.transitions import TransitionMaker, check_order


def make(decisions, rewards, arrived_at, final, discount, **changes):
    """The transitions of an episode of one feature."""
    return TransitionMaker(discount).take(edited(decided(3, decisions, rewards, arrived_at, final), **changes))


def column(transitions, name):
    return transitions.columns[name].tolist()


def test_one_train_arrives_and_one_is_truncated():
    result = make(
        decisions=[(0, 0, 2, 0.1), (1, 1, 3, 0.2), (2, 0, 4, 0.3)],
        rewards=[[-1, -10], [-2, -20], [-3, -30], [7, -40]],
        arrived_at=[2, -1],
        final=[0.0, 0.9],
        discount=0.5,
        allowed=np.array([4, 24, 17], np.uint8),
        final_allowed=np.array([31, 20], np.uint8),
    )
    assert len(result) == 3
    assert result.completed_at.tolist() == [3, 3, 4]  # step 2, the third, shows the second decision and the arrival
    assert column(result, "action_tm1") == [2, 4, 3]
    np.testing.assert_array_equal(result.columns["observation_tm1"], np.float32([[0.1], [0.3], [0.2]]))
    # -1 - 2/2;  -3 and not the 7 after the arrival;  -20 - 30/2 - 40/4
    assert column(result, "reward_t") == [-2, -3, -45]
    assert column(result, "discount_t") == [0.25, 0, 0.125]
    np.testing.assert_array_equal(result.columns["observation_t"], np.float32([[0.3], [0], [0.9]]))
    assert column(result, "allowed_t") == [17, 31, 20]
    assert column(result, "back") == [0, 1, 0]


def test_what_completes_together_is_in_the_order_of_trains():
    result = make(
        decisions=[(0, 2, 2, 0.1), (1, 0, 0, 0.2), (2, 0, 1, 0.3), (2, 2, 3, 0.4)],
        rewards=np.full((4, 3), -1),
        arrived_at=[-1, 1, 3],  # train 1 never decides
        final=[0.8, 0.0, 0.0],
        discount=1.0,
    )
    assert result.completed_at.tolist() == [3, 3, 4, 4]
    assert column(result, "action_tm1") == [0, 2, 1, 3]
    assert column(result, "reward_t") == [-1, -2, -2, -2]
    assert column(result, "discount_t") == [1, 1, 1, 0]
    assert column(result, "back") == [0, 0, 2, 2]


def test_the_bonus_reaches_the_trains_that_arrive_last():
    result = make(
        decisions=[(0, 0, 2, 0.1), (0, 1, 2, 0.2), (1, 1, 2, 0.3), (1, 2, 2, 0.4)],
        rewards=[[-1, -1, -1], [1, 1, 1]],
        arrived_at=[0, 1, 1],
        final=[0, 0, 0],
        discount=0.5,
    )
    assert column(result, "reward_t") == [-1, -1, 1, 1]
    assert column(result, "discount_t") == [0, 0.5, 0, 0]


def test_sums_run_in_double_precision():
    rewards = np.full((5000, 1), -0.1, np.float32)
    result = make([(0, 0, 2, 0.1)], rewards, [-1], [0.5], discount=1.0)
    assert column(result, "reward_t") == [np.float32(5000 * np.float64(np.float32(-0.1)))]


def test_an_episode_without_decisions_has_no_transitions():
    result = make([], [[-1, -1]], [-1, 0], [0.5, 0], discount=0.99)
    assert len(result) == 0
    assert result.columns["observation_t"].shape == (0, 1)


def test_transitions_of_one_step_end_with_it():
    result = make(
        decisions=[(0, 0, 2, 0.1), (0, 1, 1, 0.2), (1, 0, 3, 0.3), (2, 0, 4, 0.4), (3, 1, 0, 0.5)],
        rewards=[[-1, -10], [-2, -20], [-3, -30], [7, -40]],
        arrived_at=[2, -1],
        final=[0.0, 0.9],
        discount=0.5,
        following=np.float32([[0.3], [0.25], [0.4], [0.0], [0.9]]),  # train 1 sees 0.25 where it does not decide
    )
    assert result.completed_at.tolist() == [1, 1, 2, 3, 4]
    assert column(result, "action_tm1") == [2, 1, 3, 4, 0]
    np.testing.assert_array_equal(result.columns["observation_tm1"], np.float32([[0.1], [0.2], [0.3], [0.4], [0.5]]))
    assert column(result, "reward_t") == [-1, -10, -2, -3, -40]
    assert column(result, "discount_t") == [0.5, 0.5, 0.5, 0, 0.5]
    np.testing.assert_array_equal(result.columns["observation_t"], np.float32([[0.3], [0.25], [0.4], [0], [0.9]]))
    assert column(result, "allowed_t") == [31] * 5
    assert column(result, "back") == [0, 0, 2, 1, 3]


def test_a_train_that_decides_on_every_step_spans_one():
    episode = make_episode(3)
    steps = np.arange(STEPS)
    moved = {"times": steps, "trains": np.zeros(STEPS), "actions": steps % 5, "allowed": np.full(STEPS, 31)}
    decisions = {name: array.astype(getattr(episode.course.decisions, name).dtype) for name, array in moved.items()}
    zeros = {name: np.zeros(STEPS, np.float32) for name in ("log_probabilities", "values")}
    always = edited(
        episode,
        observations=-np.random.default_rng(1).random((STEPS, 6), np.float32),
        labels=np.full(STEPS, -1, np.int8),
        arrived_at=np.full(3, -1, np.int32),
        final_allowed=np.full(3, 31, np.uint8),
        **decisions,
        **zeros,
    )
    spans, single = (TransitionMaker(0.9).take(each) for each in (always, with_following(always)))
    for name, array in spans.columns.items():
        np.testing.assert_array_equal(single.columns[name], array, err_msg=name)


@settings(deadline=None)
@given(st.integers(0, 10_000), st.sets(st.integers(1, STEPS - 1)), st.booleans())
def test_an_episode_may_be_cut_anywhere(number, places, one_step):
    episode = with_following(make_episode(number)) if one_step else make_episode(number)
    whole = TransitionMaker(0.9).take(episode)
    maker = TransitionMaker(0.9)
    parts = []
    for fragment in cut(episode, places):
        parts.append(maker.take(fragment))
        assert maker.is_open == (not fragment.course.over)
        known = fragment.course.last_step
        assert sum(map(len, parts)) == np.searchsorted(whole.completed_at, known, side="right")
    np.testing.assert_array_equal(np.concatenate([part.completed_at for part in parts]), whole.completed_at)
    for name, array in whole.columns.items():
        joined = np.concatenate([part.columns[name] for part in parts])
        assert joined.dtype == array.dtype
        np.testing.assert_array_equal(joined, array)


@given(st.integers(0, 10_000), st.booleans())
@settings(deadline=None)
def test_back_leads_through_all_decisions_of_a_train(number, one_step):
    episode = with_following(make_episode(number)) if one_step else make_episode(number)
    columns = TransitionMaker(0.9).take(episode).columns
    for train in range(episode.course.n_trains):
        decisions = episode.course.decisions
        mine = decisions.observations[decisions.trains == train]
        if len(mine) == 0:
            continue
        place = int(np.flatnonzero((columns["observation_tm1"] == mine[-1]).all(-1))[0])
        chain = [place]
        while columns["back"][chain[-1]]:
            chain.append(chain[-1] - columns["back"][chain[-1]])
        np.testing.assert_array_equal(columns["observation_tm1"][chain[::-1]], mine)


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
    fragment = decided(3, decisions, -np.ones((3, 2)), [1, -1], [0, 0])
    with pytest.raises(ValueError, match=message):
        check_order(fragment)


def test_only_the_next_fragment_is_taken():
    maker = TransitionMaker(0.9)
    first, second, third = cut(make_episode(3), [10, 20])
    with pytest.raises(ValueError, match="fragment 1 of episode 3 begins after step 10: fragment 0 of episode 3"):
        maker.take(second)
    maker.take(first)
    for wrong in (first, third, make_episode(4), cut(make_episode(4), [10])[1]):
        with pytest.raises(ValueError, match="fragment 1 of episode 3 comes next, after step 10"):
            maker.take(wrong)
    maker.take(second)
    maker.forget()
    assert len(maker.take(make_episode(4))) > 0
