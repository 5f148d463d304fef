"""Steps by hand, on a line and in a ring."""

import numpy as np
import pytest
from made_rails import EAST, SOUTH, WEST, line, ring, scheduled

from railctl.common.levels.level import Level, Malfunctions
from railctl.common.rail.compiled.arrays import BROKEN, DONE, MOVING, READY, STOPPED, WAITING
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, STOP_MOVING


def world_of(level: Level, rules: str = "stock", malfunction_seed: int = 0) -> CompiledWorld:
    world = CompiledWorld(1, level.n_trains, rules=rules, decisions="always")
    world.load(0, level, malfunction_seed)
    return world


def run(world: CompiledWorld, *actions: int) -> list[tuple[int, int]]:
    """State and column of the first train after each step."""
    seen = []
    for action in actions:
        world.obey(np.full((1, world.max_trains), action, np.int8))
        train = world.batch.trains[0, 0]
        seen.append((int(train["state"]), int(world.batch.cells[0, train["config"] >> 2]["column"])))
    return seen


def columns(world: CompiledWorld) -> list[int]:
    return world.batch.cells[0]["column"][world.batch.trains[0]["config"] >> 2].tolist()


def test_a_train_of_43_waits_is_ready_departs_and_drives_on_without_orders():
    states = [state for state, _ in run(world_of(line((1, EAST, 4))), *[MOVE_FORWARD] * 3, DO_NOTHING, DO_NOTHING)]
    assert states == [READY, MOVING, MOVING, MOVING, DONE]


def test_a_train_departs_no_earlier_than_its_timetable_says():
    world = world_of(scheduled(line((1, EAST, 5)), departures=[3]))
    assert [state for state, _ in run(world, *[MOVE_FORWARD] * 4)] == [WAITING, WAITING, READY, MOVING]


def test_a_slow_train_needs_as_many_steps_for_a_cell():
    world = world_of(scheduled(line((1, EAST, 5)), speeds=[(2, 5)]))
    places = [column for _, column in run(world, *[MOVE_FORWARD] * 9)]
    assert places[1:] == [1, 1, 1, 2, 2, 3, 3, 3]
    assert world.batch.trains[0, 0]["distance"] == 4  # seven times 2 fifths
    assert world.batch.worlds[0]["unit"] == 5


def test_a_broken_train_stands_and_its_counter_runs_out():
    rng = np.random.RandomState(67)
    broken = rng.rand(1_000_000)[1:] < 1 - np.exp(-0.1)
    assert np.flatnonzero(broken[:8]).tolist() == [3]  # the draw of the fourth step
    assert rng.randint(2, 4) + 1 == 3
    world = world_of(scheduled(line((1, EAST, 6)), malfunctions=Malfunctions(0.1, 2, 3)), malfunction_seed=67)
    seen = run(world, *[MOVE_FORWARD] * 8)
    assert seen[2:] == [(MOVING, 2), (BROKEN, 2), (BROKEN, 2), (BROKEN, 2), (MOVING, 3), (MOVING, 4)]


def test_trains_that_face_each_other_stay():
    world = world_of(line((2, EAST, 6), (3, WEST, 0)))
    run(world, *[MOVE_FORWARD] * 4)
    assert columns(world) == [2, 3]
    assert world.batch.trains[0]["state"].tolist() == [STOPPED, STOPPED]


def test_a_train_follows_the_one_that_leaves():
    world = world_of(line((2, EAST, 6), (3, EAST, 6)))
    run(world, MOVE_FORWARD, MOVE_FORWARD)
    assert columns(world) == [2, 3]
    run(world, MOVE_FORWARD)
    assert columns(world) == [3, 4]


def test_the_lower_train_goes_first_whoever_asks():
    world = world_of(line((2, EAST, 5), (2, EAST, 6)))
    run(world, MOVE_FORWARD, MOVE_FORWARD)
    assert world.batch.trains[0]["state"].tolist() == [MOVING, READY]


@pytest.mark.parametrize("rules", ["stock", "legacy"])
def test_a_full_ring_turns(rules: str):
    level = ring(2, (0, 1, EAST), (1, 1, SOUTH), (1, 0, WEST), (0, 0, 0))
    world = world_of(level, rules=rules)
    run(world, *[MOVE_FORWARD] * (2 if rules == "stock" else 1))
    before = world.batch.trains[0]["config"] >> 2
    run(world, MOVE_FORWARD)
    after = world.batch.trains[0]["config"] >> 2
    assert after.tolist() == [before[1], before[2], before[3], before[0]]


def test_a_blocked_train_of_22_is_committed_and_does_not_decide():
    world = world_of(line((3, WEST, 1), (2, EAST, 5)), rules="legacy")
    run(world, MOVE_FORWARD)
    world.obey(np.array([[MOVE_FORWARD, STOP_MOVING]], np.int8))
    assert world.deciding().tolist() == [[False, True]]
    world.obey(np.array([[STOP_MOVING, DO_NOTHING]], np.int8))
    assert world.batch.trains[0]["committed"].tolist() == [MOVE_FORWARD, -1]


def test_the_limit_truncates_and_the_last_arrival_pays_all():
    world = world_of(line((1, EAST, 5), max_steps=3))
    assert sum(world.step(np.full((1, 1), MOVE_FORWARD, np.int8))[0, 0] for _ in range(3)) == -3
    assert world.over()[0]
    assert not world.arrived()[0, 0]
    assert not world.batch.worlds[0]["all_arrived"]
    world = world_of(line((1, EAST, 2), (3, EAST, 5)), rules="legacy")
    rewards = [world.obey(np.full((1, 2), MOVE_FORWARD, np.int8))[0].tolist() for _ in range(3)]
    assert rewards == [[-1, -1], [0, -1], [1, 1]]
