"""Shortest ways and a level in numbers, by hand and against the tree observation."""

import numpy as np
import pytest

from common.levels.distributions import shipped
from common.levels.level import Level
from common.levels.lines import find_line, lay_line
from common.levels.shipped import generate
from common.rail.flatland_world import FlatlandWorld
from tools.levels.routes import numbers, shortest_route

EAST_WEST, DEAD_END_EAST, DEAD_END_WEST = 1025, 4, 256  # dead ends by where they are open
SOUTH_TO_EAST, WEST_TO_NORTH, EAST_TO_NORTH, SOUTH_TO_WEST = 1 << 6, 1 << 3, 1 << 11, 1 << 4  # heading, exit


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


def cells(line: np.ndarray, width: int) -> list[tuple[int, int]]:
    return [(int(cell) // width, int(cell) % width) for cell in line]


@pytest.mark.parametrize("compiled", [True, False])
def test_a_line_goes_around_what_is_blocked_and_lays_its_rails(compiled: bool):
    find, lay = (find_line, lay_line) if compiled else (find_line.py_func, lay_line.py_func)
    grid = np.zeros((3, 4), np.uint16)
    blocked = np.zeros((3, 4), bool)
    blocked[0, 1:3] = blocked[0, 3] = True  # the end itself may be blocked
    line = find(grid, blocked, 0, 3)
    assert cells(line, 4) == [(0, 0), (1, 0), (1, 1), (1, 2), (1, 3), (0, 3)]
    lay(grid, line)
    assert grid[0].tolist() == [0, 0, 0, 0]  # nothing at the ends where nothing was
    assert grid[1, 1] == grid[1, 2] == EAST_WEST
    assert grid[1, 0] == SOUTH_TO_EAST | WEST_TO_NORTH
    assert grid[1, 3] == EAST_TO_NORTH | SOUTH_TO_WEST


@pytest.mark.parametrize("compiled", [True, False])
def test_there_may_be_no_way(compiled: bool):
    find = find_line if compiled else find_line.py_func
    blocked = np.zeros((2, 3), bool)
    blocked[:, 1] = True
    assert len(find(np.zeros((2, 3), np.uint16), blocked, 0, 2)) == 0


def test_of_equally_good_lines_the_first_found_is_taken():
    line = find_line(np.zeros((2, 2), np.uint16), np.zeros((2, 2), bool), 0, 3)
    assert cells(line, 2) == [(0, 0), (0, 1), (1, 1)]  # east was looked at before south
