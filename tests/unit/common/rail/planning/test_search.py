"""Single searches beside trying out everything, and when a plan is given up."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_rails import EAST, WEST, line, passing_loop

from railctl.common.levels.supply import LevelSupply
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE
from railctl.common.rail.compiled.step import leave
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.planning.plans import plan
from railctl.common.rail.planning.search import ANYTHING, FREE, find, room_for
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT


def loaded(level):
    world = CompiledWorld(1, level.n_trains)
    world.load(0, level)
    return world


def test_a_plan_is_given_up_once_it_cannot_be_better():
    level = line((2, EAST, 6), (3, WEST, 0))
    parts, room, ways = loaded(level).parts(), room_for(20, 7), np.empty((2, 21), np.int32)
    arrivals = np.empty(2, np.int32)
    for enough, spent in ((12, 11), (11, 11), (5, 5)):
        assert (
            plan(parts.batch, 0, np.array([1, 0]), room, 20, True, ways, arrivals, NOTHING, ANYTHING, enough) == spent
        )


def searched(world, first=ANYTHING, held=()):
    """When train 0 arrives, and its way; others hold cells, each until some time."""
    room, way = room_for(30, int(world.batch.worlds[0]["cells"])), np.empty(31, np.int32)
    for cell, until in held:
        room.held[: until + 1, cell] = 1
    return find(world.batch, 0, 0, room, 30, True, first, way), way.tolist()


def test_a_train_off_the_map_departs_first_or_waits_a_step():
    world = loaded(line((2, EAST, 6)))
    start = 2 * 4 + EAST
    for first in (ANYTHING, start):
        arrival, way = searched(world, first)
        assert (arrival, way[:2]) == (5, [NOWHERE, start])
    arrival, way = searched(world, NOWHERE)
    assert (arrival, way[:3]) == (6, [NOWHERE, NOWHERE, start])
    arrival, way = searched(world, start, held=[(2, 3)])
    assert (arrival, way[:5]) == (8, [NOWHERE, NOWHERE, NOWHERE, NOWHERE, start])


HERE, STRAIGHT, ROUND = 5 * 4 + EAST, 6 * 4 + EAST, 0 * 4  # on the passing loop: before it, and its two ways


@pytest.fixture
def before_a_loop():
    world = loaded(passing_loop((2, EAST, 6)))
    world.step(np.full((1, 1), MOVE_FORWARD, np.int8))
    assert world.batch.trains[0, 0]["config"] == HERE
    return world


@pytest.mark.parametrize(
    ("first", "arrival", "there"),
    [(ANYTHING, 4, STRAIGHT), (STRAIGHT, 4, STRAIGHT), (ROUND, 6, ROUND), (HERE, 5, HERE)],
)
def test_a_train_on_the_map_goes_first_where_it_is_told_or_waits_a_step(before_a_loop, first, arrival, there):
    found, way = searched(before_a_loop, first)
    assert (found, way[:2]) == (arrival, [HERE, there])


def test_a_train_that_is_told_where_to_go_first_waits_until_that_is_free(before_a_loop):
    held = [(STRAIGHT >> 2, 9)]
    assert searched(before_a_loop, held=held)[0] == 6
    assert searched(before_a_loop, HERE, held=held)[0] == 7
    arrival, way = searched(before_a_loop, STRAIGHT, held=held)
    assert (arrival, way[:11]) == (13, [HERE] * 10 + [STRAIGHT])


@pytest.mark.parametrize("rule", ["committed", "bound"])
def test_a_train_that_does_not_decide_any_more_does_what_it_has_to(before_a_loop, rule):
    before_a_loop.batch.trains[0, 0][rule] = MOVE_FORWARD
    for first in (ANYTHING, ROUND):
        assert searched(before_a_loop, first, held=[(STRAIGHT >> 2, 9)])[0] == 13


LEVEL = LevelSupply().evaluation("easy", 0)
STEPS = 60


def all_that_can_be(world, held):
    """Configurations that a train can be in, time by time, by trying out all actions; NOWHERE before departure."""
    codes, leads, start = world.batch.codes[0], world.batch.leads[0], int(world.batch.trains[0, 0]["start"])
    now = {NOWHERE}
    for time in range(STEPS):
        yield now
        then = {NOWHERE}
        for here in now:
            moves = (leave(codes, leads, here, action) for action in (MOVE_LEFT, MOVE_FORWARD, MOVE_RIGHT))
            for there in {start} if here == NOWHERE else {here, *moves} - {NOTHING}:
                swaps = held[time, there >> 2] != FREE and held[time, there >> 2] == held[time + 1, here >> 2]
                if held[time + 1, there >> 2] == FREE and not (here != NOWHERE and swaps):
                    then.add(int(there))
        now = then
    yield now


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), train=st.integers(0, 2), share=st.floats(0, 0.4))
def test_a_search_finds_the_earliest_arrival_there_is(seed, train, share):
    level = replace(LEVEL, starts=LEVEL.starts[[train]], targets=LEVEL.targets[[train]], max_steps=STEPS)
    world, rng = loaded(level), np.random.default_rng(seed)
    cells = int(world.batch.worlds[0]["cells"])
    room, way = room_for(STEPS, cells), np.empty(STEPS + 1, np.int32)
    others = np.repeat(rng.integers(0, 3, (STEPS // 4 + 1, cells)), 4, axis=0)[: STEPS + 1]
    room.held[:] = np.where(rng.random((STEPS + 1, cells)) < share, others, FREE)
    times = list(all_that_can_be(world, room.held))
    targets = set(np.flatnonzero(world.batch.distances[0, 0, : cells * 4] == 0).tolist())
    expected = next((time for time, places in enumerate(times) if places & targets), NOTHING)
    assert find(world.batch, 0, 0, room, STEPS, True, ANYTHING, way) == expected
    on_map = np.flatnonzero(way != NOWHERE)
    assert on_map.tolist() == (list(range(on_map[0], expected + 1)) if expected != NOTHING else [])
    assert all(int(way[time]) in times[time] for time in on_map)
