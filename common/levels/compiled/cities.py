"""Where cities lie, how many tracks they have, and how they face; as flatland-rl's sparse rails draw it.

Source: `SparseRailGen` of flatland-rl 4.3.0, and where that drew otherwise, `sparse_rail_generator` of 2.2.2. A city
is a square around its middle. Its tracks run side by side, from the side that faces its nearest neighbour to the one
across. Every track has an inner point at either end; some go on to an outer point, on the border, from which lines lead
to other cities.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.levels.compiled.twister import State, draw_below

Cities = NDArray[np.int64]  # [C, FIELDS]

ROW, COLUMN, SIDE, TRACKS, OUT, FIRST_OUT = range(6)  # of a city; SIDE: that faces its neighbour, 0 north to 3 west
FIELDS = 6

PLACE_TRIES = 201  # 2.2.2 gave up on a city after so many places


@kernel
def reject_places(state: State, wanted: int, radius: int, height: int, width: int) -> NDArray[np.int64]:
    """[C, 2]: the middles of cities, as 2.2.2 drew them: anywhere, again where there is one already."""
    margin = radius + 1
    middles, count = np.empty((wanted, 2), np.int64), 0
    for _ in range(wanted):
        for _try in range(PLACE_TRIES):
            row = margin + draw_below(state, height - 2 * margin)
            column = margin + draw_below(state, width - 2 * margin)
            free = True
            for city in range(count):
                apart = max(abs(row - middles[city, 0]), abs(column - middles[city, 1]))
                free = free and apart > 2 * margin
            if free:
                middles[count, 0], middles[count, 1] = row, column
                count += 1
                break
    return middles[:count]


@kernel
def pick_places(state: State, wanted: int, radius: int, height: int, width: int) -> NDArray[np.int64]:
    """[C, 2]: the middles of cities, as 4.3.0 draws them: one of the cells that are left."""
    margin = radius + 1
    middles, count = np.empty((wanted, 2), np.int64), 0
    taken = np.zeros((height, width), np.bool_)
    left = (height - 2 * margin) * (width - 2 * margin)
    while count < wanted and left > 0:
        number, left = draw_below(state, left), 0
        for row in range(margin, height - margin):
            for column in range(margin, width - margin):
                if not taken[row, column]:
                    if number == 0:
                        middles[count, 0], middles[count, 1] = row, column
                    number -= 1
        for row in range(margin, height - margin):
            for column in range(margin, width - margin):
                apart = max(abs(row - middles[count, 0]), abs(column - middles[count, 1]))
                taken[row, column] = taken[row, column] or apart <= 2 * margin
                left += not taken[row, column]
        count += 1
    return middles[:count]


@cache
def even_places(wanted: int, radius: int, height: int, width: int) -> NDArray[np.int64]:
    """[C, 2]: the middles of cities in rows and columns, where drawing found no place for two."""
    side = 2 * (radius + 1)
    rows = min(int(np.ceil(np.sqrt(wanted * (height / width)))), (height - 2) // side)
    columns = min(int(np.ceil(wanted / rows)), (width - 2) // side)
    down = np.linspace(radius + 2, height - (radius + 2), rows, dtype=int)
    across = np.linspace(radius + 2, width - (radius + 2), columns, dtype=int)
    return np.array([(down[city % rows], across[city // rows]) for city in range(min(wanted, rows * columns))])


def by_distance(middles: NDArray[np.int64]) -> NDArray[np.int64]:
    """[C, C]: for each city all cities, the nearest first; equally near ones as numpy's own sort leaves them."""
    ranked: NDArray[np.int64] = np.abs(middles[:, None] - middles).sum(axis=2).argsort(axis=1)
    return ranked


@bare_kernel
def side_towards(row: int, column: int, to_row: int, to_column: int) -> int:
    """The library's `direction_to_point`: 0 north, 1 east, 2 south, 3 west."""
    up, left = row - to_row, column - to_column
    if abs(up) >= abs(left):
        return 0 if up > 0 else 2
    return 3 if left > 0 else 1


@kernel
def draw_cities(state: State, middles: NDArray[np.int64], most_tracks: int, most_out: int, in_pairs: bool) -> Cities:
    """Draw the tracks of cities and their ways out.

    Args:
        state: of the generator.
        middles: [C, 2], two or more.
        most_tracks: in a city.
        most_out: lines from either side of a city.
        in_pairs: tracks come in pairs, as in 4.3.0; else any number from two.
    """
    cities = np.zeros((len(middles), FIELDS), np.int64)
    for city in range(len(middles)):
        nearest, least = 0, -1
        for other in range(len(middles)):
            apart = abs(middles[city, 0] - middles[other, 0]) + abs(middles[city, 1] - middles[other, 1])
            if other != city and (least < 0 or apart < least):
                nearest, least = other, apart
        tracks = 2 * (1 + draw_below(state, most_tracks // 2)) if in_pairs else 2 + draw_below(state, most_tracks - 1)
        out = 1 + draw_below(state, min(most_out, tracks))
        row, column = middles[city, 0], middles[city, 1]
        cities[city, ROW], cities[city, COLUMN] = row, column
        cities[city, SIDE] = side_towards(row, column, middles[nearest, 0], middles[nearest, 1])
        cities[city, TRACKS], cities[city, OUT], cities[city, FIRST_OUT] = tracks, out, (tracks - out) // 2
    return cities


@bare_kernel
def _point(city: NDArray[np.int64], side: int, track: int, outwards: int) -> tuple[int, int]:
    row, column = city[ROW], city[COLUMN]
    aside = track - city[FIRST_OUT]
    if side == 0:
        return row - outwards, column + aside
    if side == 1:
        return row + aside, column + outwards
    if side == 2:
        return row + outwards, column + aside
    return row + aside, column - outwards


@bare_kernel
def inner_point(city: NDArray[np.int64], radius: int, side: int, track: int) -> tuple[int, int]:
    """The row and column where a track ends; tracks are the shorter, the farther from the middle one they are."""
    from_middle = track - city[TRACKS] // 2
    return _point(city, side, track, radius - (abs(from_middle) + min(max(from_middle, 0), 1) + 1))


@bare_kernel
def outer_point(city: NDArray[np.int64], radius: int, side: int, track: int) -> tuple[int, int]:
    """The row and column where a track leaves the city."""
    return _point(city, side, track, radius)


@bare_kernel
def station(city: NDArray[np.int64], radius: int, track: int) -> tuple[int, int]:
    """The row and column in the middle of a track, where trains start and stop."""
    side = city[SIDE] % 2
    row, column = inner_point(city, radius, side, track)
    to_row, to_column = inner_point(city, radius, side + 2, track)
    return (
        min(row, to_row) + (abs(row - to_row) + 1) // 2 * (row != to_row),
        min(column, to_column) + (abs(column - to_column) + 1) // 2 * (column != to_column),
    )


@bare_kernel
def fits(cities: Cities, radius: int, height: int, width: int) -> bool:
    """Whether there is a cell on every side of all ends of tracks: many tracks may reach beyond their city."""
    for at in range(len(cities)):
        city = cities[at]
        for side in (city[SIDE], (city[SIDE] + 2) % 4):
            for track in range(city[TRACKS]):
                row, column = inner_point(city, radius, side, track)
                if not (0 < row < height - 1 and 0 < column < width - 1):
                    return False
    return True
