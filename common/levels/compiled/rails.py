"""Rails in and between cities, drawn by all that was drawn of the cities.

Source: `SparseRailGen` of flatland-rl 4.3.0: `_connect_cities`, `_build_inner_cities` and `_fix_transitions`. Where it
differs from 2.2.2 (ways of lines, order of repairs), both rules are here.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.levels.compiled.cities import (
    COLUMN,
    FIRST_OUT,
    OUT,
    ROW,
    SIDE,
    TRACKS,
    Cities,
    fits,
    inner_point,
    outer_point,
    side_towards,
)
from railctl.common.levels.compiled.lines import LINE, SEARCH_ROWS, find_line, lay_line
from railctl.common.levels.compiled.repairs import NO_SIDE, ahead, is_broken, repair
from railctl.common.levels.compiled.set_order import city_cells_as_set
from railctl.common.levels.compiled.twister import WORDS, seed_by_number

_REPAIR_SEED = 12  # the library repairs all maps with the same random numbers


class TracksLeaveGridError(IndexError):
    """Tracks reach so far beyond their city that they leave the grid."""


def lay_rails(
    cities: Cities, ranked: NDArray[np.int64], radius: int, size: tuple[int, int], legacy: bool
) -> NDArray[np.uint16]:
    """[H, W]: the rails of cities and between them.

    Args:
        cities: [C, FIELDS].
        ranked: [C, C], for each city all of them, the nearest first.
        radius: of the cities.
        size: rows and columns of the grid.
        legacy: whether it goes as in 2.2.2.

    Raises:
        TracksLeaveGridError: some tracks do not fit.
    """
    height, width = size
    if not fits(cities, radius, height, width):
        raise TracksLeaveGridError(
            f"tracks leave the grid of {height}x{width}: lower their number, or make size larger"
        )
    grid, sides = np.zeros(size, np.uint16), np.full(size, NO_SIDE)
    claim(cities, radius, sides)
    lines = connect(grid, sides, cities, ranked, radius, legacy)
    build_tracks(grid, cities, radius)
    in_cities = city_cells_in_turn(cities, radius, width) if legacy else city_cells_as_set(cities, radius, width)
    repair_all(grid, in_cities, lines, sides)
    return grid


@bare_kernel
def claim(cities: Cities, radius: int, sides: NDArray[np.int64]) -> None:
    """Note in the cells of cities [H, W] which side switches there should face: towards the middle of the city."""
    for at in range(len(cities)):
        middle_row, middle_column = cities[at, ROW], cities[at, COLUMN]
        for row in range(middle_row - radius, middle_row + radius + 1):
            for column in range(middle_column - radius, middle_column + radius + 1):
                if cities[at, SIDE] % 2 == 0:
                    sides[row, column] = 2 if row > middle_row else 0
                else:
                    sides[row, column] = 3 if column < middle_column else 1


@bare_kernel
def _neighbours(cities: Cities, ranked: NDArray[np.int64], city: int, nearest: NDArray[np.int64]) -> None:
    """Find the nearest city on each side; where there is none, the one before, after, or across.

    Args:
        cities: [C, FIELDS].
        ranked: [C, C], for each city all of them, the nearest first.
        city: whose neighbours.
        nearest: [8], the first four are overwritten with the answer.
    """
    for side in range(8):
        nearest[side] = -1
    for place in range(1, len(cities)):
        other = ranked[city, place]
        side = side_towards(cities[city, ROW], cities[city, COLUMN], cities[other, ROW], cities[other, COLUMN])
        if nearest[4 + side] < 0:
            nearest[4 + side] = other
    for side in range(4):
        for turn in (2, 1, 3, 0):
            if nearest[4 + (side + turn) % 4] >= 0:
                nearest[side] = nearest[4 + (side + turn) % 4]


@bare_kernel
def _nearest_way_in(city: NDArray[np.int64], radius: int, row: int, column: int, width: int) -> int:
    """The outer point of a city that is next to a cell, as `row * W + column`."""
    best, least = -1, -1
    for side in range(city[SIDE] % 2, 4, 2):
        for track in range(city[FIRST_OUT], city[FIRST_OUT] + city[OUT]):
            there, across = outer_point(city, radius, side, track)
            apart = abs(row - there) + abs(column - across)
            if least < 0 or apart < least:
                best, least = there * width + across, apart
    return best


@kernel
def connect(
    grid: NDArray[np.uint16],
    sides: NDArray[np.int64],
    cities: Cities,
    ranked: NDArray[np.int64],
    radius: int,
    legacy: bool,
) -> NDArray[np.int64]:
    """Lay a line from each outer point to the nearest one of the neighbour on its side; all cells of the lines.

    Args:
        grid: [H, W], overwritten.
        sides: [H, W], NO_SIDE outside of cities, where lines may pass.
        cities: [C, FIELDS].
        ranked: [C, C], for each city all of them, the nearest first.
        radius: of the cities.
        legacy: whether it goes as in 2.2.2.
    """
    width = grid.shape[1]
    search = np.empty((SEARCH_ROWS, grid.size), np.int64)
    nearest = np.empty(8, np.int64)
    cells, count = np.empty(grid.size, np.int64), 0
    for city in range(len(cities)):
        _neighbours(cities, ranked, city, nearest)
        for side in range(cities[city, SIDE] % 2, 4, 2):
            for track in range(cities[city, FIRST_OUT], cities[city, FIRST_OUT] + cities[city, OUT]):
                row, column = outer_point(cities[city], radius, side, track)
                end = _nearest_way_in(cities[nearest[side]], radius, row, column, width)
                length = find_line(grid, sides, (row * width + column, end), legacy, search)
                if length == 0 or (length == 1 and not legacy):
                    continue
                lay_line(grid, search[LINE], length)
                if count + length > len(cells):
                    cells = _longer(cells, count + grid.size)
                for at in range(length):
                    cells[count + at] = search[LINE, at]
                count += length
    return cells[:count]


@kernel
def _longer(cells: NDArray[np.int64], length: int) -> NDArray[np.int64]:
    longer = np.empty(length, np.int64)
    for at in range(len(cells)):
        longer[at] = cells[at]
    return longer


@bare_kernel
def _lay_straight(grid: NDArray[np.uint16], row: int, column: int, to_row: int, to_column: int) -> None:
    """Lay rails both ways over the cells in a row or column, the ends included."""
    along = side_towards(row, column, to_row, to_column)
    rails = np.uint16(1 << (15 - 5 * along)) | np.uint16(1 << (15 - 5 * ((along + 2) % 4)))
    for at in range(min(row, to_row), max(row, to_row) + 1):
        for across in range(min(column, to_column), max(column, to_column) + 1):
            grid[at, across] |= rails


@bare_kernel
def _join_neighbours(grid: NDArray[np.uint16], row: int, column: int) -> None:
    """Where an end of a track has rails on two sides, lead from one to the other over it."""
    count, first, last = 0, -1, -1
    for side in range(4):
        if grid[ahead(row, column, side)] > 0:
            count += 1
            first, last = side if first < 0 else first, side
    if count != 2:
        return
    grid[row, column] = 1 << (15 - 4 * ((first + 2) % 4) - last) | 1 << (15 - 4 * ((last + 2) % 4) - first)
    for side in (first, last):
        grid[ahead(row, column, side)] |= np.uint16(1 << (15 - 4 * side - (side + 2) % 4))


@bare_kernel
def build_tracks(grid: NDArray[np.uint16], cities: Cities, radius: int) -> None:
    """Lay the tracks of cities, join them with each other, and with the outer points."""
    for at in range(len(cities)):
        city = cities[at]
        near, far = city[SIDE] % 2, city[SIDE] % 2 + 2
        for track in range(city[TRACKS]):
            row, column = inner_point(city, radius, near, track)
            to_row, to_column = inner_point(city, radius, far, track)
            _lay_straight(grid, row, column, to_row, to_column)
        for track in range(city[TRACKS]):
            for side in range(near, 4, 2):
                row, column = inner_point(city, radius, side, track)
                _join_neighbours(grid, row, column)
            if city[FIRST_OUT] <= track < city[FIRST_OUT] + city[OUT]:
                for side in range(near, 4, 2):
                    row, column = inner_point(city, radius, side, track)
                    to_row, to_column = outer_point(city, radius, side, track)
                    _lay_straight(grid, row, column, to_row, to_column)


@kernel
def city_cells_in_turn(cities: Cities, radius: int, width: int) -> NDArray[np.int64]:
    """The cells of cities, city by city, row by row."""
    cells, count = np.empty(len(cities) * (2 * radius + 1) * (2 * radius + 1), np.int64), 0
    for city in range(len(cities)):
        for row in range(cities[city, ROW] - radius, cities[city, ROW] + radius + 1):
            for column in range(cities[city, COLUMN] - radius, cities[city, COLUMN] + radius + 1):
                cells[count] = row * width + column
                count += 1
    return cells


@kernel
def repair_all(
    grid: NDArray[np.uint16], in_cities: NDArray[np.int64], on_lines: NDArray[np.int64], sides: NDArray[np.int64]
) -> None:
    """Repair what is broken; which cells are is decided before any is repaired."""
    width = grid.shape[1]
    broken, count = np.empty(len(in_cities) + len(on_lines), np.int64), 0
    for at in range(len(broken)):
        cell = in_cities[at] if at < len(in_cities) else on_lines[at - len(in_cities)]
        if is_broken(grid, cell // width, cell % width):
            broken[count] = cell
            count += 1
    state = np.empty(WORDS + 1, np.int64)
    seed_by_number(state, _REPAIR_SEED)
    for at in range(count):
        row, column = broken[at] // width, broken[at] % width
        repair(grid, row, column, sides[row, column], state)
