"""Rounds of questions on the compiled world, and what trains are told that are not asked."""

from dataclasses import replace

import numpy as np
import pytest
from made_rails import EAST, fork, line, ring, scheduled

from railctl.common.levels.supply import LevelSupply
from railctl.common.rail.compiled.arrays import BROKEN_OFF_MAP, MOVING, READY
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.flatland_world import FlatlandWorld
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING


@pytest.mark.parametrize(("mode", "then"), [("off", MOVING), ("valid", MOVING), ("safe", READY), ("planned", READY)])
def test_a_repaired_train_comes_onto_the_map_when_it_is_asked(mode, then):
    world = CompiledWorld(1, 1, rules="stock", interlocking=mode)
    world.load(0, replace(scheduled(ring(10, (0, 4, EAST))), targets=np.array([[9, 4]], np.int32)))
    train, nobody_decides = world.batch.trains[0, 0], np.zeros((1, 1), np.int8)
    train["malfunction"] = 2
    for state in (BROKEN_OFF_MAP, BROKEN_OFF_MAP, then):
        world.step(nobody_decides)
        assert train["state"] == state


@pytest.mark.parametrize("engine", [CompiledWorld, FlatlandWorld])
@pytest.mark.parametrize(("mode", "arrives"), [("off", False), ("valid", False), ("safe", True), ("planned", True)])
@pytest.mark.parametrize(("row", "turn"), [(0, MOVE_LEFT), (2, MOVE_RIGHT)])
@pytest.mark.parametrize("decisions", ["cells", "always"])
def test_a_slow_train_runs_to_the_end_of_a_cell_that_only_branches_to_both_sides(
    decisions, row, turn, mode, arrives, engine
):
    world = engine(1, 1, rules="stock", interlocking=mode, decisions=decisions)
    world.load(0, scheduled(fork(row), speeds=[(1, 4)]))
    while not world.over()[0]:
        actions = np.full((1, 1), MOVE_FORWARD, np.int8)
        for train, allowed in world.ask(0):
            actions[0, train] = MOVE_FORWARD if allowed >> MOVE_FORWARD & 1 else turn
        world.step(actions)
    assert world.arrived()[0, 0] == arrives


@pytest.mark.parametrize("engine", [CompiledWorld, FlatlandWorld])
@pytest.mark.parametrize("mode", ["safe", "planned"])
def test_who_has_stood_on_the_map_for_long_goes_on_if_it_may(mode, engine):
    world = engine(1, 2, interlocking=mode, decisions="always", patience=3)
    world.load(0, line((2, EAST, 6), (3, EAST, 6)))
    on, stop = 1 << MOVE_FORWARD, 1 << STOP_MOVING
    for _ in range(5):  # off the map they have all the time
        assert world.allowed(0).tolist() == [on | stop, on | stop]
        world.step(np.full((1, 2), STOP_MOVING, np.int8))
    world.step(np.full((1, 2), MOVE_FORWARD, np.int8))
    for allowed in (on | stop, on | stop, on | stop, on):
        assert world.allowed(0).tolist() == [stop, allowed]  # train 1 stands where train 0 would go
        world.step(np.full((1, 2), STOP_MOVING, np.int8))


@pytest.mark.parametrize("mode", ["off", "valid", "safe", "planned"])
def test_everybody_who_decides_is_asked_once(mode):
    world = CompiledWorld(1, 7, interlocking=mode)
    world.load(0, LevelSupply().training("hard", 1))
    asked = set()
    while not world.over()[0]:
        actions, seen = np.full((1, 7), STOP_MOVING, np.int8), []
        asking = world.ask(0)
        for train, allowed in asking:
            assert allowed
            actions[0, train] = MOVE_FORWARD if allowed >> MOVE_FORWARD & 1 else allowed.bit_length() - 1
            asking.grant(train, int(actions[0, train]))
            seen.append(train)
        assert sorted(seen) == np.flatnonzero(world.deciding()[0]).tolist()
        asked |= set(seen)
        world.step(actions)
    assert asked == set(range(7))
