"""Lines between cities, by hand and against the library's search."""

import numpy as np
import pytest
from flatland.core.grid.grid4_astar import a_star
from flatland.core.grid.grid_utils import Vec2dOperations
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from from_library import find_legacy_line

from railctl.common.levels.compiled.lines import LINE, SEARCH_ROWS, find_line, lay_line
from railctl.common.levels.compiled.repairs import NO_SIDE
from railctl.tools.levels.library import forget_rails

EAST_WEST = 1025
SOUTH_TO_EAST, WEST_TO_NORTH, EAST_TO_NORTH, SOUTH_TO_WEST = 1 << 6, 1 << 3, 1 << 11, 1 << 4  # heading, exit

Cell = tuple[int, int]


def line_of(
    grid: np.ndarray, blocked: np.ndarray, start: int, end: int, *, first_found: bool, compiled: bool = True
) -> np.ndarray:
    search = np.empty((SEARCH_ROWS, grid.size), np.int64)
    find = find_line if compiled else find_line.py_func
    length = find(grid, np.where(blocked, 0, NO_SIDE), (start, end), first_found, search)
    return search[LINE, :length]


def cells(line: np.ndarray, width: int) -> list[Cell]:
    return [(int(cell) // width, int(cell) % width) for cell in line]


@pytest.mark.parametrize("first_found", [True, False])
@pytest.mark.parametrize("compiled", [True, False])
def test_a_line_goes_around_what_is_blocked_and_lays_its_rails(compiled: bool, first_found: bool):
    grid = np.zeros((3, 4), np.uint16)
    blocked = np.zeros((3, 4), bool)
    blocked[0, 1:3] = blocked[0, 3] = True  # the end itself may be blocked
    line = line_of(grid, blocked, 0, 3, first_found=first_found, compiled=compiled)
    assert cells(line, 4) == [(0, 0), (1, 0), (1, 1), (1, 2), (1, 3), (0, 3)]
    (lay_line if compiled else lay_line.py_func)(grid, line, len(line))
    assert grid[0].tolist() == [0, 0, 0, 0]  # nothing at the ends where nothing was
    assert grid[1, 1] == grid[1, 2] == EAST_WEST
    assert grid[1, 0] == SOUTH_TO_EAST | WEST_TO_NORTH
    assert grid[1, 3] == EAST_TO_NORTH | SOUTH_TO_WEST


@pytest.mark.parametrize("first_found", [True, False])
def test_there_may_be_no_way(first_found: bool):
    blocked = np.zeros((2, 3), bool)
    blocked[:, 1] = True
    assert len(line_of(np.zeros((2, 3), np.uint16), blocked, 0, 2, first_found=first_found)) == 0


def test_of_equally_good_lines_the_first_found_is_taken():
    line = line_of(np.zeros((2, 2), np.uint16), np.zeros((2, 2), bool), 0, 3, first_found=True)
    assert cells(line, 2) == [(0, 0), (0, 1), (1, 1)]  # east was looked at before south


@pytest.mark.parametrize("first_found", [True, False])
def test_lines_are_those_of_both_versions_of_the_library(first_found: bool):
    rng, differing = np.random.default_rng(1), 0
    for _ in range(120):
        height, width = rng.integers(6, 16, 2).tolist()
        grid = np.where(rng.random((height, width)) < 0.3, EAST_WEST, 0).astype(np.uint16)
        blocked = rng.random((height, width)) < 0.15
        start, end = rng.choice(height * width, 2, replace=False).tolist()
        closed = {(row, column) for row, column in np.argwhere(blocked).tolist()}
        here, there = divmod(start, width), divmod(end, width)
        line = cells(line_of(grid, blocked, start, end, first_found=first_found), width)
        old = find_legacy_line(grid, closed, here, there)
        rails = RailGridTransitionMap(width, height, grid=grid.copy())
        new = a_star(rails, here, there, Vec2dOperations.get_manhattan_distance, True, False, closed)
        assert line == (old if first_found else new)
        differing += old != new
    assert differing > 10  # or the test would show nothing
    forget_rails()
