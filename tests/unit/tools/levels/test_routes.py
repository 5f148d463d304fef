"""Shortest ways and a level in numbers, by hand and against the tree observation."""

import numpy as np
import pytest

from railctl.common.levels.distributions import shipped
from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.rail.flatland_world import FlatlandWorld
from railctl.tools.levels.routes import numbers, shortest_route

EAST_WEST, DEAD_END_EAST, DEAD_END_WEST = 1025, 4, 256  # dead ends by where they are open


def corridor(start: tuple[int, int, int], target: tuple[int, int]) -> Level:
    """Four cells of straight track between two dead ends."""
    grid = np.array([[DEAD_END_EAST, EAST_WEST, EAST_WEST, DEAD_END_WEST]], np.uint16)
    return Level(grid, np.array([start], np.int32), np.array([target], np.int32), 10)


def test_straight_on():
    assert shortest_route(corridor((0, 1, 1), (0, 3)), 0) == [(0, 1, 1), (0, 2, 1), (0, 3, 1)]


def test_a_dead_end_turns_a_train():
    route = shortest_route(corridor((0, 1, 3), (0, 2)), 0)
    assert route == [(0, 1, 3), (0, 0, 3), (0, 1, 1), (0, 2, 1)]


def test_numbers_by_hand():
    assert numbers(corridor((0, 1, 3), (0, 2))) == (4, 0, [3])
    no_way = corridor((0, 1, 3), (0, 2))
    no_way.grid[0, 0] = 0
    assert numbers(no_way) == (3, 0, [-1])


@pytest.mark.parametrize("difficulty", shipped())
def test_distances_are_those_that_trains_observe(difficulty: str):
    world = FlatlandWorld(slots=1, max_trains=7)
    for seed in range(3):
        level = generate(difficulty, seed)
        world.load(0, level)
        observed = [round((world.observe(0, train)[6] + 1) * 100) for train in range(level.n_trains)]
        assert numbers(level).distances == observed
