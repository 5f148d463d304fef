"""What a teacher says in situations by hand."""

import numpy as np
import pytest
from made_rails import EAST, WEST, line, passing_loop, scheduled

from railctl.common.rail.compiled.arrays import UNREACHED
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.planning.advising import NONE
from railctl.common.rail.planning.judging import Teacher
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING

ON, STOP, LEFT, RIGHT = MOVE_FORWARD, STOP_MOVING, MOVE_LEFT, MOVE_RIGHT
BROKEN_STEPS = 8
SAVED = BROKEN_STEPS - 2  # by the way round, which is two steps longer


def loaded(level, rules="legacy"):
    world = CompiledWorld(1, level.n_trains, rules=rules)
    world.load(0, level)
    return world


def said(world, train, allowed=ALL_ACTIONS, **changed):
    teacher = Teacher(**{"orders": 1, "margin": 1, "patience": 16, "key": np.uint64(7)} | changed)
    return world.advise(0, train, allowed, teacher)


def bits(*actions):
    return sum(1 << action for action in actions)


@pytest.fixture
def behind_a_broken_train():
    """Train 0 may go round train 1, which stands before it on its shortest way for a while, or wait."""
    world = loaded(scheduled(passing_loop((2, EAST, 6), (3, EAST, 6), max_steps=100)), "stock")
    for action in (STOP, ON):
        world.step(np.full((1, 2), action, np.int8))
    assert world.deciding()[0, 0]
    world.batch.trains[0, 1]["malfunction"] = BROKEN_STEPS
    return world


@pytest.mark.parametrize("orders", [1, 3])
def test_of_two_that_meet_on_a_line_the_farther_one_waits_off_the_map_however_long(orders):
    world = loaded(line((2, EAST, 6), (3, WEST, 0)))
    world.batch.trains[0]["stood"] = 100
    assert [said(world, train, orders=orders) for train in range(2)] == [STOP, ON]


def test_where_both_ways_round_are_as_good_a_train_takes_its_shortest_and_the_other_gives_way():
    world = loaded(passing_loop((2, EAST, 6), (4, WEST, 0)))
    world.step(np.full((1, 2), ON, np.int8))
    assert [said(world, train) for train in range(2)] == [ON, RIGHT]


@pytest.mark.parametrize(("margin", "action"), [(1, LEFT), (SAVED, LEFT), (SAVED + 1, ON)])
def test_a_way_round_has_to_save_the_margin(behind_a_broken_train, margin, action):
    assert said(behind_a_broken_train, 0, margin=margin) == action


@pytest.mark.parametrize(("margin", "action"), [(SAVED - 1, STOP), (SAVED, ON)])
def test_a_train_waits_a_step_for_a_way_that_it_is_not_allowed_now(behind_a_broken_train, margin, action):
    assert said(behind_a_broken_train, 0, bits(ON, STOP), margin=margin) == action


@pytest.mark.parametrize(("stood", "action"), [(15, LEFT), (16, ON)])
def test_a_train_that_has_stood_too_long_takes_the_shortest_way_it_is_allowed(behind_a_broken_train, stood, action):
    behind_a_broken_train.batch.trains[0, 0]["stood"] = stood
    assert said(behind_a_broken_train, 0) == action
    assert said(behind_a_broken_train, 0, bits(LEFT, STOP)) == LEFT


def test_who_has_no_choice_hears_nothing(behind_a_broken_train):
    for allowed in (bits(ON), bits(STOP), bits(LEFT), bits(ON, RIGHT)):  # there are no rails to the right
        assert said(behind_a_broken_train, 0, allowed) == NONE


def test_where_no_way_leads_home_a_train_stops(behind_a_broken_train):
    behind_a_broken_train.batch.distances[0, 0] = UNREACHED
    assert said(behind_a_broken_train, 0) == STOP
