"""The traffic observation, by hand on small rails; that both engines show it is tested by whole episodes."""

from typing import Any

import numpy as np
import pytest
from made_rails import EAST, WEST, line, passing_loop, scheduled

from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE, empty_batch
from railctl.common.rail.compiled.conflicts import compare
from railctl.common.rail.compiled.ways import ways_for
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.traffic_shape import N_EXIT, N_EXITS, N_MEETING, N_OTHER, N_TRAIN
from railctl.common.rail.world import MOVE_FORWARD, MOVE_RIGHT, STOP_MOVING

LEFT, FORWARD, RIGHT = range(N_EXITS)
OPPOSITE = (1, EAST, 6), (6, EAST, 0)  # the second comes out of a dead end
ONLY_WESTWARDS = 0x0001
MIX = [0.05, 0.1, 0.7, 0.1, 0.05]


class Seen:
    """A vector in its parts: `train` [13], `exits` [3, 16], `others` [rows, 10], `meetings` [rows, 3, 15]."""

    def __init__(self, world: CompiledWorld, train: int) -> None:
        self.vector = world.observe(0, train)
        end = N_TRAIN + N_EXITS * N_EXIT
        rows = self.vector[end:].reshape(-1, N_OTHER + N_EXITS * N_MEETING)
        self.train, self.exits = self.vector[:N_TRAIN], self.vector[N_TRAIN:end].reshape(N_EXITS, N_EXIT)
        self.others, self.meetings = rows[:, :N_OTHER], rows[:, N_OTHER:].reshape(-1, N_EXITS, N_MEETING)


def played(
    level: Level, steps: int, rules: Any = "legacy", others: int = 2, action: int = MOVE_FORWARD
) -> CompiledWorld:
    """The level after so many steps, in which all trains do the same."""
    world = CompiledWorld(1, level.n_trains, rules=rules, observation=TrafficObservation(others=others))
    world.load(0, level)
    for _ in range(steps):
        world.obey(np.full((1, level.n_trains), action, np.int8))
    return world


def same(numbers: np.ndarray, expected: list[float]) -> None:
    np.testing.assert_allclose(numbers, expected, rtol=0, atol=1e-7)


def test_a_train_among_others_by_hand():
    """Two steps in: one train is at column 2 to the east, the other at column 5 to the west."""
    seen = Seen(played(passing_loop(*OPPOSITE), 2), 0)
    slack = (20 - 2 - 4) / 20
    same(seen.train, [1, 0.04, 0.1, 0.2, 0.2, 0, slack, slack, 0.1, 0, 0, 0, 1])


def test_exits_by_hand():
    seen = Seen(played(passing_loop(*OPPOSITE), 2), 0)
    left, forward = seen.exits[LEFT].copy(), seen.exits[FORWARD].copy()
    left[1] = forward[1] = 1  # what the interlocking says has its own tests
    same(left, [1, 1, 1, 0.05, 0.08, 0, 0, 0, 0.15, 0, 0.9, 0.9, 0.2, 0, 0, 0])
    same(forward, [1, 1, 1, 0.03, 0, 1, 0, 0, 0.05, 0, 0.94, 0.94, 0.2, 0, 0, 0])
    assert not seen.exits[RIGHT].any()


def test_another_train_by_hand():
    seen = Seen(played(passing_loop(*OPPOSITE), 2), 0)
    same(seen.others[0], [1, 1, 0, 0, 0.05, 0, 1, 0, 0.94, 0.94])
    same(seen.meetings[0, FORWARD], [1, 1, 0.2, 1, -0.15, -0.15, 0, 0, 1, 1, 0.98, 0, 0, 0.94, 0.02])
    same(seen.meetings[0, LEFT], [1, 0.92, 0.1, 1, -0.25, 0.15, 0.6, 0, 1, 0, 0, 0, 0, 0.9, -0.02])
    assert not seen.meetings[0, RIGHT].any()
    assert not seen.others[1].any()
    assert not seen.meetings[1].any()


def test_both_may_wait_before_a_stretch():
    """Off the map, too; after the first stretch there is another one, which does not count."""
    seen = Seen(played(line((1, EAST, 4), (6, EAST, 0)), 0), 0)
    same(seen.meetings[0, FORWARD, [1, 2, 3, 6, 7]], [0.98, 0.2, 0.94, 0.2, 0.6])
    ways = ways_for(empty_batch(1, 1, cells=10))
    for row, cells in enumerate(([6, 0, 1, 2, 3, 4, 5], [5, 4, 9, 8, 7, 1, 0])):
        ways.paths[row, :7], ways.lengths[row] = 4 * np.array(cells), 7
        ways.places[row, cells] = range(7)
        ways.paces[row] = 1
    numbers = np.zeros(N_MEETING, np.float32)
    assert compare(ways, 0, 1, numbers) == 1
    same(numbers[:8], [1, 0.98, 0.1, 0.9, 0.15, -0.25, 0.2, 0.6])


def test_what_follows_by_hand():
    """The second train is where the first comes from: behind it by two cells, then beside it, then late."""
    world = played(line((3, EAST, 6), (1, EAST, 5)), 1)
    first, second = Seen(world, 0), Seen(world, 1)
    same(first.meetings[0, FORWARD], [0] * 11 + [0.98, -0.1, 0, 0.02])
    same(second.meetings[0, FORWARD], [0] * 11 + [0.96, 0.1, 0.96, -0.02])
    same(second.exits[FORWARD], [1, second.exits[FORWARD, 1], 1, 0.03, 0, 1, 0, 0, 0.2, 1, 0.96, 0, 0, 0, 0, 0])
    assert (first.others[0, 3], second.others[0, 3]) == (0, 1)
    assert (first.others[0, 9], second.others[0, 9]) == (np.float32(0.96), 0)


def test_speeds_malfunctions_and_departures_count_in_steps():
    level = scheduled(passing_loop(*OPPOSITE, max_steps=40), speeds=[(1, 2), (1, 4)], arrivals=[20, 40])
    world = played(level, 4, "stock")  # the first has just come to the switch, the second is in the middle of its cell
    world.batch.trains[0, 1]["malfunction"] = 2
    seen = Seen(world, 0)
    same(seen.train[[6, 7, 12]], [0.7, 0.2, 0.5])
    same(seen.exits[FORWARD, [10, 11, 13]], [0.92, 0, 0.1])
    same(seen.others[0], [1, 1, 0, 0, 0.06, 0.1, 0.25, 0, 0.92, 0.92])
    same(seen.meetings[0, FORWARD], [1, 1, 0.25, 1, -0.4, -0.8, 0, 0, 1, 1, 0, 0.92, 0.4, 0.92, 0.04])
    later = scheduled(passing_loop(*OPPOSITE, max_steps=40), departures=[0, 9])
    same(Seen(played(later, 3, "stock"), 0).meetings[0, FORWARD, [4, 5]], [0.15, -0.55])


def test_the_most_urgent_have_rows_and_the_rest_is_counted():
    """The train behind is the nearest, but who comes towards the first is in conflict with it."""
    level = line((3, EAST, 6), (2, EAST, 5), (6, EAST, 0), (5, WEST, 0))
    seen = Seen(played(level, 1), 0)
    same(seen.others[:, 8], [0.96, 0.94])
    assert not seen.exits[FORWARD, 14:].any()
    seen = Seen(played(level, 1, others=1), 0)
    same(seen.others[:, 8], [0.96])
    same(seen.exits[FORWARD, 14:], [0.2, 1])


def test_those_without_conflict_come_by_nearness():
    world = played(line((1, EAST, 3), (5, EAST, 6), (4, EAST, 6)), 0, others=3)
    same(Seen(world, 0).others[:, 8], [0.94, 0.92, 0])


def test_a_committed_train_goes_where_it_is_committed_to():
    world = played(passing_loop((2, EAST, 6), (4, WEST, 0)), 1)
    assert Seen(world, 0).meetings[0, FORWARD, 0] == 1
    world.batch.trains[0, 1]["committed"] = MOVE_RIGHT
    world = played_again(world)
    assert Seen(world, 0).meetings[0, FORWARD, 0] == 0
    assert Seen(world, 0).meetings[0, LEFT, 0] == 1


def played_again(world: CompiledWorld) -> CompiledWorld:
    """Forget what trains saw before the state was changed by hand."""
    world._seen = None
    return world


def test_patience_counts_steps_of_standing_and_of_waiting_to_depart():
    level = scheduled(line((1, EAST, 6), (4, EAST, 6), (2, EAST, 6)), departures=[0, 0, 30])
    world = played(level, 1, "stock")
    go, stop = MOVE_FORWARD, STOP_MOVING
    found = []
    for actions in ((go, stop, stop), (stop, stop, stop), (stop, go, stop), (go, stop, stop)):
        world.obey(np.array([actions], np.int8))
        found.append(world.batch.trains[0]["stood"].tolist())
    assert found == [[0, 2, 0], [1, 3, 0], [2, 0, 0], [0, 1, 0]]
    assert Seen(world, 1).train[9] == np.float32(0.05)


def test_a_way_that_leads_nowhere_is_no_way():
    """A train that is past its target turns in the dead end, unless there is none."""
    seen = Seen(played(line((3, EAST, 1)), 1), 0)
    same(seen.exits[FORWARD, 2:6], [1, 0.07, 0, 1])
    level = line((3, EAST, 1))
    level.grid[0, 5:] = ONLY_WESTWARDS, 0
    seen = Seen(played(level, 1), 0)
    same(seen.exits[FORWARD, 2:6], [0, 1, 1, 0])
    assert seen.train[[1, 6, 7]].tolist() == [1, -1, -1]


def test_who_has_arrived_sees_nothing():
    world = played(line((4, EAST, 5), (1, EAST, 6)), 4, "stock")
    assert world.arrived()[0].tolist() == [True, False]
    assert not Seen(world, 0).vector.any()
    assert not Seen(world, 1).others.any()


@pytest.mark.parametrize("others", [1, 3, 6])
def test_values_are_in_range_and_absent_things_are_zeros(others: int):
    level, rng = generate("hard", others), np.random.default_rng(others)
    world = CompiledWorld(1, 7, observation=TrafficObservation(others=others))
    world.load(0, level)
    for _ in range(60):
        for train in np.flatnonzero(world.deciding()[0]).tolist():
            seen = Seen(world, train)
            assert np.abs(seen.vector).max() <= 1
            assert not seen.exits[seen.exits[:, 0] == 0].any()
            assert not seen.meetings[:, seen.exits[:, 0] == 0].any()
            assert not seen.meetings[seen.others[:, 0] == 0].any()
            there = seen.others[:, 0].tolist()
            assert there == sorted(there, reverse=True)
        world.step(rng.choice(5, p=MIX, size=(1, 7)).astype(np.int8))


def test_what_a_train_sees_does_not_depend_on_who_else_looks():
    world, rng = played(generate("hard", 4), 0), np.random.default_rng(0)
    compared = 0
    for _ in range(40):
        together = world.observe_deciding()[1]
        for row, train in enumerate(np.flatnonzero(world.deciding()[0]).tolist()):
            asking = np.zeros((1, 7), np.bool_)
            asking[0, train] = True
            assert world._look(asking)[0].tobytes() == together[row].tobytes()
            compared += 1
        world.step(rng.choice(5, p=MIX, size=(1, 7)).astype(np.int8))
    assert compared > 50


def test_numbers_of_trains_change_nothing_but_who_goes_first():
    level, rng = generate("hard", 5), np.random.default_rng(5)
    order = rng.permutation(7)
    renumbered = Level(level.grid, level.starts[order], level.targets[order], level.max_steps)
    one, two = played(level, 0, others=6), played(renumbered, 0, others=6)
    compared = 0
    for _ in range(60):
        copy_state(one, two, order)
        for train in np.flatnonzero(one.deciding()[0]).tolist():
            seen, again = Seen(one, train), Seen(two, int(np.flatnonzero(order == train)[0]))
            np.testing.assert_array_equal(seen.train, again.train)
            np.testing.assert_array_equal(seen.exits, again.exits)
            np.testing.assert_array_equal(rows_of(seen), rows_of(again))
            compared += 1
        one.step(rng.choice(5, p=MIX, size=(1, 7)).astype(np.int8))
    assert compared > 50


def copy_state(one: CompiledWorld, two: CompiledWorld, order: np.ndarray) -> None:
    """Let trains of the second world, `order[i]` being the first world's number of i, be as in the first."""
    two.batch.trains[0] = one.batch.trains[0][order]
    two.batch.worlds[0] = one.batch.worlds[0]
    two.batch.codes[0] = one.batch.codes[0]
    two.batch.cells[0] = one.batch.cells[0]
    for number, train in enumerate(two.batch.trains[0]):
        if train["config"] != NOWHERE:
            two.batch.cells[0, train["config"] >> 2]["train"] = number
    assert (two.batch.cells[0]["train"] != NOTHING).sum() == (one.batch.cells[0]["train"] != NOTHING).sum()
    two._seen = None


def rows_of(seen: Seen) -> np.ndarray:
    """The rows in an order that does not depend on numbers, without who has the lower one."""
    rows = np.concatenate([seen.others, seen.meetings.reshape(len(seen.others), -1)], axis=1)
    rows[:, 3] = 0
    return rows[np.lexsort(rows.T)]
