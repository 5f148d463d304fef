"""Single searches beside trying out everything, and when a plan is given up."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from made_rails import EAST, WEST, line

from common.levels.supply import LevelSupply
from common.rail.compiled.arrays import NOTHING, NOWHERE
from common.rail.compiled.step import leave
from common.rail.compiled.world import CompiledWorld
from common.rail.planning.plans import plan
from common.rail.planning.search import ANYTHING, FREE, find, room_for
from common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT


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
