"""An episode put together from its fragments is the same however it was cut, but for its digest."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from made_episodes import STEPS, cut, edited, make_episode

from railctl.services.learner.opened import OpenEpisode


def test_nothing_has_progressed_before_the_first_fragment():
    assert OpenEpisode().progressed is None
    assert (OpenEpisode().steps, OpenEpisode().decisions, OpenEpisode().reward) == (0, 0, 0.0)


@settings(deadline=None, max_examples=30)
@given(number=st.integers(0, 50), cuts=st.sets(st.integers(1, STEPS - 1), max_size=4))
def test_its_sums_do_not_depend_on_the_cut(number, cuts):
    whole = make_episode(number)
    fragments = cut(whole, sorted(cuts))
    assert len(fragments) == len(cuts) + 1
    one, many = OpenEpisode([whole]), OpenEpisode(fragments)
    assert (many.steps, many.decisions, many.reward) == (one.steps, one.decisions, one.reward)
    assert many.steps == STEPS
    np.testing.assert_array_equal(many.progressed.actions, whole.course.decisions.actions)


def test_any_actor_can_go_on_where_it_stands():
    first, second, _ = cut(make_episode(1), [7, 20])
    progressed = OpenEpisode([first, second]).progressed
    assert (progressed.fragment, progressed.first_step) == (2, 20)
    np.testing.assert_array_equal(
        progressed.actions, np.concatenate([part.course.decisions.actions for part in (first, second)])
    )
    np.testing.assert_array_equal(progressed.states, second.course.states)


def test_the_digest_tells_fragments_and_their_order():
    first, second, third = cut(make_episode(1), [7, 20])
    digests = {OpenEpisode(part).digest for part in ([first], [first, second], [second, first], [first, second, third])}
    assert len(digests) == 4
    assert OpenEpisode([first, second]).digest == OpenEpisode([edited(first, actor="b"), second]).digest
