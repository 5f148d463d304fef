"""The account of a run, with times of a made-up clock."""

import numpy as np
import pytest
from made_episodes import cut, edited, make_episode

from railctl.common.recent import RECENT_EPISODES
from railctl.services.learner.account import RATE_WINDOW_S, Account, is_due, row_of
from railctl.services.learner.opened import OpenEpisode


def row(number=0, **changes):
    return row_of(OpenEpisode([make_episode(number)]), number + 1, 5.0).model_copy(update=changes)


def test_a_row_sums_up_all_fragments_and_names_the_first_weights_and_the_last_actor():
    whole = make_episode(3)
    first, *between, last = cut(whole, [7, 20])
    first = edited(first, acting_s=0.25, weights_version=9)
    last = edited(last, acting_s=0.5, actor="b", weights_version=11, score=0.75)
    made = row_of(OpenEpisode([first, *between, last]), 12, 5.00049)  # its fragments came to versions 10, 11 and 12
    assert (made.episode, made.level, made.seed, made.actor, made.weights_version) == (3, "easy", 1, "b", 9)
    assert (made.acting_s, made.trained_unix_s, made.score) == (0.75, 5.0, 0.75)
    assert (made.steps, made.trains, made.decisions) == (40, 3, len(whole.course.decisions))
    assert made.arrived == int((whole.course.arrived_at >= 0).sum())
    assert made.normalised_return == whole.course.normalised_return
    assert made.learned_reward == float(whole.course.rewards.sum())
    assert made.staleness == 0


def test_an_episode_is_as_stale_as_weights_came_while_it_was_acted():
    episode = edited(make_episode(7), weights_version=3)
    assert row_of(OpenEpisode([episode]), 8, 5.0).staleness == 4  # trained into version 7


def test_the_return_does_not_depend_on_what_is_learned_from():
    episode = make_episode(3)
    shaped = edited(episode, rewards=episode.course.rewards * np.float32(0.5))
    one, other = (row_of(OpenEpisode([made]), 4, 5.0) for made in (episode, shaped))
    assert one.normalised_return == other.normalised_return
    assert other.learned_reward == one.learned_reward / 2


def test_the_pace_is_that_of_the_last_moments():
    account = Account([], now=100.0)
    assert account.pace(100.0) == (0.0, 0.0)
    for second in range(1, 11):
        account.end_episode(row(steps=50), 100.0 + second)
    assert account.pace(110.0) == (1.0, 50.0)
    later = 110.0 + RATE_WINDOW_S
    assert account.pace(later) == (0.0, 0.0)  # the last one ended as the window began
    account.end_episode(row(steps=30), later)
    assert account.pace(later) == pytest.approx((1 / RATE_WINDOW_S, 30 / RATE_WINDOW_S))


def test_returns_are_those_of_the_last_episodes_and_steps_those_of_all():
    rows = [row(normalised_return=-1.0, steps=2), row(normalised_return=-0.5, steps=3)]
    account = Account(rows, now=0.0)
    assert (account.mean_return, account.steps) == (-0.75, 5)
    for _ in range(RECENT_EPISODES):
        account.end_episode(row(normalised_return=-0.25, steps=1), 1.0)
    assert (account.mean_return, account.steps) == (-0.25, 5 + RECENT_EPISODES)
    assert Account([], now=0.0).mean_return is None


def test_staleness_is_that_of_the_last_episodes():
    account = Account([row(staleness=2), row(staleness=None), row(staleness=4)], now=0.0)  # one of an earlier version
    assert account.mean_staleness == 2.0
    for _ in range(RECENT_EPISODES):
        account.end_episode(row(staleness=3), 1.0)
    assert account.mean_staleness == 3.0
    assert Account([], now=0.0).mean_staleness is None


@pytest.mark.parametrize(
    ("trained", "finished", "due"), [(10, False, True), (11, False, False), (11, True, True), (20, True, True)]
)
def test_what_happens_every_so_often_happens_at_the_end_too(trained, finished, due):
    assert is_due(trained, 10, finished=finished) is due
