"""The compiled world: what it refuses, how slots go together, trees of other depths."""

import numpy as np
import played
import pytest
from made_rails import (
    ALONG,
    NORTH_EAST,
    NORTH_WEST,
    SOUTH_EAST,
    SOUTH_WEST,
    WEST_END,
    line,
    scheduled,
)

from railctl.common.levels.distributions import Bounds
from railctl.common.levels.level import Level, Malfunctions
from railctl.common.levels.shipped import generate
from railctl.common.rail.compiled.arrays import DONE, NOWHERE
from railctl.common.rail.compiled.looking import look_at_all
from railctl.common.rail.compiled.tree import LEGACY, REPAIRED, STOCK, nodes_of
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.normalise import normalise
from railctl.common.rail.observations.global_map import GlobalObservation
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.rail.world import MOVE_FORWARD, STOP_MOVING

MODES = {"stock": STOCK, "legacy": LEGACY, "repaired": REPAIRED}


def random_actions(world: CompiledWorld, rng: np.random.Generator) -> np.ndarray:
    return rng.choice(5, p=[0.05, 0.1, 0.7, 0.1, 0.05], size=(world.slots, world.max_trains)).astype(np.int8)


@pytest.mark.parametrize("features", ["detour", "plain"])
@pytest.mark.parametrize("tree", MODES)
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_vectors_are_the_normalised_trees(tree: str, depth: int, features: str):
    rules = "legacy" if tree == "legacy" else "stock"
    conflicts = "repaired" if tree == "repaired" else "library"
    observation = TreeObservation(depth=depth, features=features, conflicts=conflicts)
    world = CompiledWorld(2, 7, rules=rules, observation=observation, bounds=Bounds(30, 40, 7))
    rng = np.random.default_rng(depth)
    for slot in range(2):
        level = generate("hard", slot)
        speeds = [(1, 1 + train % 3) for train in range(7)]
        world.load(slot, scheduled(level, speeds=speeds) if rules == "stock" else level)
    trees = np.empty((2, 7, nodes_of(depth), 12), np.float32)
    for _ in range(60):
        look_at_all(world.batch, world.parts().sight, MODES[tree], depth, trees)
        if tree != "repaired":
            assert world.trees(depth=depth).tobytes() == trees.tobytes()
        for slot, train in np.argwhere(world.batch.trains["config"] != NOWHERE).tolist():
            vector = world.observe(slot, train)
            assert vector.shape == (world.n_features,)
            expected = normalise(trees[slot, train], features, 100 if features == "detour" else 140)
            assert vector.tobytes() == expected.tobytes()
        world.obey(random_actions(world, rng))


def test_a_deeper_tree_holds_the_shallower_one():
    world = CompiledWorld(1, 7)
    world.load(0, generate("hard", 1))
    np.testing.assert_array_equal(world.trees(depth=1)[0], world.trees(depth=3)[0][:, [0, 1, 22, 43, 64]])


def test_slots_are_worlds_of_their_own():
    alone, together = CompiledWorld(1, 7), CompiledWorld(3, 7)
    alone.load(0, generate("hard", 4))
    for slot, level in enumerate((played.LEVEL, generate("hard", 4), generate("easy", 1))):  # room grows on the way
        together.load(slot, level)
    rng = np.random.default_rng(0)
    for step in range(100):
        if step == 50:
            together.load(0, generate("medium", 2))
        actions = random_actions(together, rng)
        assert together.step(actions)[1].tobytes() == alone.step(actions[1:2])[0].tobytes()
        np.testing.assert_array_equal(together.deciding()[1], alone.deciding()[0])
        assert together.trees()[1].tobytes() == alone.trees()[0].tobytes()


def test_observations_do_not_change_later():
    world = CompiledWorld(1, 3)
    world.load(0, played.LEVEL)
    where, vectors = world.observe_deciding()
    kept = where.copy(), vectors.copy()
    for _ in range(5):
        world.step(np.full((1, 3), MOVE_FORWARD, np.int8))
        world.observe_deciding()
    np.testing.assert_array_equal(where, kept[0])
    np.testing.assert_array_equal(vectors, kept[1])


def test_arrays_of_another_shape_are_refused():
    world = CompiledWorld(2, 3)
    with pytest.raises(ValueError, match=r"shape \(2, 2\) for 2 slots of 3 trains"):
        world.step(np.zeros((2, 2), np.int8))
    with pytest.raises(ValueError, match="contiguous float32 array"):
        world.trees(out=np.zeros((2, 3, 5, 12), np.float32))


def test_a_refused_level_leaves_the_slot_over():
    world = CompiledWorld(1, 3)
    world.load(0, played.LEVEL)
    world.batch.trains["state"] = DONE
    with pytest.raises(ValueError, match="no train can stand"):
        world.load(0, Level(played.LEVEL.grid, played.LEVEL.starts, np.zeros((3, 2), np.int32), 20))
    assert world.over()[0]
    assert not world.deciding().any()
    assert not world.arrived().any()


def test_nothing_loaded_is_over_and_cannot_be_seen():
    world = CompiledWorld(2, 3)
    assert world.over().all()
    assert not world.step(np.full((2, 3), MOVE_FORWARD, np.int8)).any()
    with pytest.raises(ValueError, match="slot 1 was never loaded"):
        world.observe(1, 0)


def test_an_arrived_train_of_22_sees_nothing():
    world = CompiledWorld(1, 3)
    world.load(0, played.LEVEL)
    while not world.arrived()[0, 0]:
        world.obey(np.array([[MOVE_FORWARD, 0, 0]], np.int8))
    assert np.isnan(world.trees()[0, 0]).all()
    with pytest.raises(ValueError, match="train 0 has arrived"):
        world.observe(0, 0)
    with pytest.raises(ValueError, match="slot 0 has no train 3"):
        world.observe(0, 3)


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="7 trains, the world has room for 3"):
        CompiledWorld(1, 3).load(0, generate("hard", 1))
    loose = Level(np.full((1, 3), ALONG, np.uint16), np.array([[0, 0, 1]]), np.array([[0, 2]]), 20)
    with pytest.raises(ValueError, match="off the grid"):
        CompiledWorld(1, 3).load(0, loose)
    nowhere = Level(played.LEVEL.grid, played.LEVEL.starts, np.array([[1, 5], [0, 0], [2, 4]], np.int32), 20)
    world = CompiledWorld(1, 3)
    with pytest.raises(ValueError, match="no train can stand on the target of train 1"):
        world.load(0, nowhere)
    assert world.over()[0]


def snake(side: int) -> Level:
    """A line through all cells of a square grid, row after row; a train at its start, bound for its end."""
    grid = np.full((side, side), ALONG, np.uint16)
    grid[0::2, -1], grid[1::2, -1] = NORTH_EAST, SOUTH_EAST
    grid[1::2, 0], grid[2::2, 0] = NORTH_WEST, SOUTH_WEST
    grid[0, 0] = grid[-1, 0] = WEST_END
    return Level(grid, np.array([[0, 0, 3]], np.int32), np.array([[side - 1, 0]], np.int32), 20)


def test_there_is_room_for_large_levels_and_what_is_too_large_is_refused():
    world = CompiledWorld(1, 1)
    world.load(0, snake(100))
    assert world.batch.worlds[0]["cells"] == 10_000
    assert world.batch.distances[0, 0, 3] == 9_999  # from the dead end
    world.step(np.full((1, 1), MOVE_FORWARD, np.int8))
    world.step(np.full((1, 1), MOVE_FORWARD, np.int8))
    assert world.trees()[0, 0, 0, 6] == 9_998
    with pytest.raises(ValueError, match="too far from a target: 32,766 cells"):
        world.load(0, snake(182))
    assert world.over()[0]


def test_observations_that_depend_on_the_largest_level_are_told_of_it():
    for observation in (GlobalObservation(), TreeObservation(features="plain")):
        with pytest.raises(ValueError, match="give its bounds"):
            CompiledWorld(1, 3, observation=observation)
    world = CompiledWorld(1, 3, observation=GlobalObservation(), bounds=Bounds(3, 5, 3))
    with pytest.raises(ValueError, match="has 3x6 cells, the world has room for 3x5"):
        world.load(0, played.LEVEL)


@pytest.mark.parametrize(
    "order",
    [
        {"speeds": [(1, 1), (1, 2), (1, 1)]},
        {"departures": [0, 1, 0]},
        {"malfunctions": Malfunctions(0.1, 1, 2)},
        {"headings": [0b0001, 0, 0]},
    ],
)
def test_the_rules_of_22_know_plain_schedules_only(order: dict):
    level = scheduled(played.LEVEL, **order)
    with pytest.raises(ValueError, match="use stock rules"):
        CompiledWorld(1, 3).load(0, level)
    if "headings" not in order:  # on the dead end to the east nobody heads north
        CompiledWorld(1, 3, rules="stock").load(0, level)


def test_the_rules_of_22_take_a_plain_schedule():
    usable = scheduled(played.LEVEL, arrivals=[3, 4, 5], headings=[0b0010, 0, 0b1111])
    CompiledWorld(1, 3).load(0, usable)


def test_schedules_are_checked():
    world = CompiledWorld(1, 3, rules="stock")
    for order, message in (
        ({"speeds": [(1, 1)] * 2}, "not one of 3 trains"),
        ({"departures": [1]}, "not one of 3 trains"),
        ({"speeds": [(0, 1)] * 3}, "not above 0 and at most 1"),
        ({"speeds": [(3, 2)] * 3}, "not above 0 and at most 1"),
        ({"speeds": [(1, 1009), (1, 2003), (1, 1)]}, "common denominator"),
    ):
        with pytest.raises(ValueError, match=message):
            world.load(0, scheduled(played.LEVEL, **order))


def test_a_target_is_reached_with_the_headings_that_count():
    level = scheduled(line((1, 1, 3)), headings=[0b1000])
    world = CompiledWorld(1, 1, rules="stock")
    world.load(0, level)
    columns = []
    while not world.over()[0] and len(columns) < 12:
        world.obey(np.full((1, 1), MOVE_FORWARD, np.int8))
        columns.append(int(world.batch.cells[0, world.batch.trains[0, 0]["config"] >> 2]["column"]))
    assert columns[1:9] == [1, 2, 3, 4, 5, 6, 5, 4]  # past the target, and back to it from the end of the line
    assert world.arrived()[0, 0]


def test_the_cells_rule_spares_broken_trains_and_those_within_a_cell():
    world = CompiledWorld(1, 3, rules="stock", decisions="cells")
    world.load(0, scheduled(played.LEVEL, speeds=[(1, 2)] * 3))
    for _ in range(2):
        world.obey(np.full((1, 3), MOVE_FORWARD, np.int8))
    assert world.deciding().tolist() == [[False] * 3]  # on the map, but with half a cell to go
    world.obey(np.full((1, 3), MOVE_FORWARD, np.int8))
    assert world.deciding()[0, 0]
    world.batch.trains[0]["malfunction"] = 5
    world.step(np.full((1, 3), STOP_MOVING, np.int8))
    assert not world.deciding().any()
