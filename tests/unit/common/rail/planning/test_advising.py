"""Advice in situations by hand, and from the states that random play leads to, where plans have to come true."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from made_rails import ALONG, EAST, EAST_END, EAST_TO_NORTH, NORTH_EAST, NORTH_WEST, WEST, WEST_END, line, scheduled

from railctl.common.levels.level import Level
from railctl.common.levels.supply import LevelSupply
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.planning.advising import NONE, action_of, advise, by_lot, desk_for, horizon
from railctl.common.rail.planning.plans import by_distance, plan
from railctl.common.rail.planning.search import ANYTHING
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING

ON, STOP, LEFT, RIGHT = MOVE_FORWARD, STOP_MOVING, MOVE_LEFT, MOVE_RIGHT
WEST_TO_NORTH = 0x0400 | 0x0001 | 0x0008 | 0x0040
KEY = np.uint64(7)


def loaded(level, rules="legacy", decisions="cells"):
    world = CompiledWorld(1, level.n_trains, rules=rules, decisions=decisions)
    world.load(0, level)
    return world


def advice(world, orders=1):
    parts, labels = world.parts(), np.zeros(world.max_trains, np.int8)
    desk = desk_for(parts.batch, int(parts.batch.worlds[0]["max_steps"]))
    advise(parts.batch, 0, parts.deciding[0], parts.decisions, orders, KEY, desk, labels)
    return labels.tolist()


def follow(world, **options):
    """Steps until each train has arrived, if all follow the advice; 0 for never."""
    actions = np.full((1, world.max_trains), ON, np.int8)
    while not world.over()[0]:
        labels = np.array(advice(world, **options))
        actions[0] = np.where(labels == NONE, STOP, labels)
        world.step(actions)
    return np.maximum(world.batch.trains[0]["arrived_at"], 0).tolist()


def test_of_two_that_meet_on_a_line_one_waits_off_the_map():
    world = loaded(line((2, EAST, 6), (3, WEST, 0)))
    assert advice(world) == [STOP, ON]
    assert follow(world) == [7, 4]


def test_who_asks_for_nothing_hears_nothing():
    world = loaded(line((2, EAST, 6), (1, EAST, 6)))
    world.step(np.array([[ON, STOP]], np.int8))
    assert world.deciding()[0].tolist() == [False, True]
    assert advice(world) == [NONE, ON]


def test_face_to_face_on_a_line_there_is_no_way():
    world = loaded(line((2, EAST, 6), (4, WEST, 0)), decisions="always")
    world.step(np.array([[ON, ON]], np.int8))
    world.step(np.array([[ON, ON]], np.int8))
    assert NONE in advice(world, orders=4)


def passing_place(*trains):
    """A line of ten cells, on which one may go round by the row above from cell 3 to 6; trains as on `line`."""
    grid = np.zeros((2, 10), np.uint16)
    grid[0, 3:7] = NORTH_WEST, ALONG, ALONG, NORTH_EAST
    grid[1] = [WEST_END, *[ALONG] * 8, EAST_END]
    grid[1, 3], grid[1, 6] = EAST_TO_NORTH, WEST_TO_NORTH
    starts = np.array([[1, start, heading] for start, heading, _ in trains], np.int32)
    targets = np.array([[1, target] for _, _, target in trains], np.int32)
    return Level(grid, starts, targets, max_steps=60)


def test_on_the_map_two_that_meet_pass_each_other():
    world = loaded(passing_place((1, EAST, 8), (8, WEST, 1)))
    world.step(np.array([[ON, ON]], np.int8))
    assert follow(world) == [8, 10]  # the way by the row above takes two steps more


def test_a_fast_train_overtakes():
    level = passing_place((2, EAST, 9), (1, EAST, 8))
    world = loaded(scheduled(level, speeds=[(1, 4), (1, 1)]), "stock")
    world.step(np.array([[STOP, STOP]], np.int8))
    world.step(np.array([[ON, STOP]], np.int8))
    assert follow(world) == [2 + 7 * 4, 17]  # no more than the slow one takes alone


def test_lots_are_the_same_whoever_has_arrived():
    everyone, some = np.arange(9), np.array([7, 1, 4, 3])
    by_lot(everyone, KEY, 30)
    by_lot(some, KEY, 30)
    assert [train for train in everyone if train in some] == some.tolist()
    assert everyone.tolist() != sorted(everyone)


def test_planned_anew_in_every_step_all_arrive_about_as_soon_as_by_one_plan():
    for index in range(3):
        world = loaded(LevelSupply().evaluation("medium", index))
        parts, trains = world.parts(), np.arange(world.max_trains)
        steps = int(parts.batch.worlds[0]["max_steps"])
        desk = desk_for(parts.batch, steps)
        by_distance(parts.batch, 0, desk.order)
        plan(parts.batch, 0, desk.order, desk.room, steps, False, desk.ways, desk.arrivals, NOTHING, ANYTHING, 1 << 60)
        arrivals = follow(world)
        assert min(arrivals) > 0
        assert np.mean(arrivals) <= desk.arrivals[trains].mean() + 1


@pytest.mark.parametrize("rules", ["legacy", "stock"])
@settings(max_examples=40, deadline=None)
@given(index=st.integers(0, 40), seed=st.integers(0, 2**32 - 1), before=st.integers(0, 30), orders=st.integers(1, 3))
def test_plans_come_true_from_wherever_trains_got_to(rules, index, seed, before, orders):
    rng, level = np.random.default_rng(seed), LevelSupply().evaluation("medium", index)
    if rules == "stock":
        speeds = [(1, int(rng.integers(1, 5))) for _ in range(level.n_trains)]
        departures = rng.integers(0, 20, level.n_trains).tolist()
        level = scheduled(replace(level, max_steps=level.max_steps * 4), speeds=speeds, departures=departures)
    world = loaded(level, rules)
    actions = np.full((1, level.n_trains), ON, np.int8)
    for _ in range(before):
        if not world.over()[0]:
            actions[0] = rng.choice([ON, ON, ON, ON, ON, LEFT, RIGHT, STOP], level.n_trains)
            world.step(actions)
    parts = world.parts()
    trains, steps = parts.batch.trains[0], horizon(parts.batch, 0)
    desk = desk_for(parts.batch, steps)
    count = by_distance(parts.batch, 0, desk.order)
    for _ in range(orders - 1):
        rng.shuffle(desk.order[:count])
    plan(
        parts.batch,
        0,
        desk.order[:count],
        desk.room,
        steps,
        False,
        desk.ways,
        desk.arrivals,
        NOTHING,
        ANYTHING,
        1 << 60,
    )
    planned = desk.order[:count]
    assume((desk.arrivals[planned] != NOTHING).all())
    for time in range(1, desk.arrivals[planned].max(initial=0) + 1):
        for at in planned:
            actions[0, at] = action_of(parts.batch, 0, at, int(desk.ways[at, time]))
        world.step(actions)
        foreseen = np.where(time < desk.arrivals[planned], desk.ways[planned, time], NOWHERE)
        np.testing.assert_array_equal(trains["config"][planned], foreseen)
    assert world.arrived()[0].all()
