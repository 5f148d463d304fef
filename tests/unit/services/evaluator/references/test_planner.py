"""Plans for small worlds by hand, carried out."""

import numpy as np
import pytest

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.planning.plans import plan
from railctl.common.rail.planning.search import ANYTHING, room_for
from railctl.services.evaluator.references.planner import best_ways
from railctl.services.evaluator.references.policies import reference_policy

EAST, WEST = 1, 3
ALONG, WEST_END, EAST_END = 0x0401, 0x0004, 0x0100
ACROSS, NORTH_END, SOUTH_END, CROSSING = 0x8020, 0x2000, 0x0080, 0x8421


def line(*trains, max_steps=20):
    """A line of seven cells; each train is start column, heading, target column."""
    return Level(
        grid=np.array([[WEST_END, ALONG, ALONG, ALONG, ALONG, ALONG, EAST_END]], np.uint16),
        starts=np.array([[0, start, heading] for start, heading, _ in trains], np.int32),
        targets=np.array([[0, target] for _, _, target in trains], np.int32),
        max_steps=max_steps,
    )


def loaded(level, rules="legacy"):
    world = CompiledWorld(1, level.n_trains, rules=rules)
    world.load(0, level)
    return world


def columns(level, rules="legacy", orders=1):
    """Where trains are planned to be, step after step; None off the map, until all have arrived."""
    world = loaded(level, rules)
    ways = best_ways(0, orders, 0, world.parts())
    steps = np.flatnonzero((ways != NOWHERE).any(0)).max() + 1
    column = world.batch.cells[0]["column"]
    return [[None if here == NOWHERE else int(column[here >> 2]) for here in way[:steps]] for way in ways]


def arrivals(level, **options):
    """Steps until each train has arrived, carried out."""
    return (reference_policy("planner", CompiledWorld(1, level.n_trains), **options)(0, level).arrived_at + 1).tolist()


def test_a_train_follows_in_the_very_step_and_its_target_is_free_in_the_next():
    level = line((2, EAST, 6), (3, EAST, 6))
    assert columns(level) == [[None, 2, 3, 4, 5, 6], [None, 3, 4, 5, 6, None]]
    assert arrivals(level) == [5, 4]


def test_trains_of_one_start_depart_one_after_the_other():
    level = line((3, EAST, 6), (3, EAST, 5))
    assert columns(level) == [[None, None, 3, 4, 5, 6], [None, 3, 4, 5, None, None]]
    assert arrivals(level) == [5, 3]


def test_trains_that_would_change_places_wait_off_the_map():
    level = line((2, EAST, 6), (3, WEST, 0))
    assert columns(level) == [[None, None, None, 2, 3, 4, 5, 6], [None, 3, 2, 1, 0, None, None, None]]
    assert arrivals(level) == [7, 4]


def test_under_stock_rules_trains_depart_a_step_later():
    assert columns(line((5, EAST, 6)), "stock") == [[None, None, 5, 6]]


def test_a_train_that_starts_on_its_target_arrives_as_it_departs():
    level = line((4, EAST, 4), (3, EAST, 6))
    assert columns(level) == [[None, 4, None, None, None], [None, 3, 4, 5, 6]]
    assert arrivals(level) == [1, 4]


def test_a_crossing_is_passed_one_after_the_other():
    level = Level(
        grid=np.array([[0, NORTH_END, 0], [WEST_END, CROSSING, EAST_END], [0, SOUTH_END, 0]], np.uint16),
        starts=np.array([[1, 0, WEST], [0, 1, 0]], np.int32),
        targets=np.array([[1, 2], [2, 1]], np.int32),
        max_steps=9,
    )
    assert arrivals(level) == [3, 4]


@pytest.mark.parametrize("trains", [[(2, EAST, 6), (5, WEST, 0)], [(5, WEST, 0), (2, EAST, 6)]])
def test_who_cannot_arrive_in_time_stays_out_of_the_way(trains):
    level = line(*trains, max_steps=6)
    assert sorted(arrivals(level)) == [0, 5]  # the nearer one goes, the other one could after that, but for the limit
    assert reference_policy("planner", CompiledWorld(1, 2))(0, level).rewards.sum() == -6 - 4


def test_more_orders_find_what_the_first_does_not():
    """The nearest one goes west and lets two others wait; better that it waits for them."""
    level = line((3, WEST, 0), (2, EAST, 6), (1, EAST, 6))
    assert arrivals(level, orders=1) == [4, 7, 9]
    assert arrivals(level, orders=20) == [7, 5, 6]


def test_draws_are_those_of_seed_and_number_and_the_first_order_is_by_distance():
    level = line((2, EAST, 6), (5, WEST, 0), (3, EAST, 6), (4, WEST, 0), (1, EAST, 6), max_steps=60)
    parts = loaded(level).parts()
    np.testing.assert_array_equal(best_ways(3, 8, 2, parts), best_ways(3, 8, 2, parts))
    room, ways = room_for(60, 7), np.empty((5, 61), np.int32)
    plan(
        parts.batch, 0, np.array([2, 0, 3, 1, 4]), room, 60, True, ways, np.empty(5, np.int32), NOTHING, ANYTHING, 10**6
    )
    np.testing.assert_array_equal(best_ways(3, 1, 2, parts), ways)
