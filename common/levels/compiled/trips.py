"""Who goes where: the draws of flatland-rl's schedule and line generators.

Source: `sparse_schedule_generator` of flatland-rl 2.2.2; `SparseLineGen` and `timetable_generator` of 4.3.0.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.levels.compiled.cities import SIDE, TRACKS, station
from railctl.common.levels.compiled.distances import NO_WAY, measure
from railctl.common.levels.compiled.layout import Layout
from railctl.common.levels.compiled.twister import State, draw_below, draw_pair, draw_uniform

_Ints = NDArray[np.int32]
_Cities = NDArray[np.int64]

START_ROW, START_COLUMN, HEADING, TARGET_ROW, TARGET_COLUMN, STEPS = range(6)  # of a trip
FIELDS = 6
_UNMEASURED = -2
_DRAWN_STATIONS = 10  # 4.3.0 draws a number below and takes what remains after division by the stations


class Trips(NamedTuple):
    """Who goes where.

    Attributes:
        starts: [N, 3], row, column, heading.
        targets: [N, 2], row, column.
        steps: [N], from start to target; NO_WAY: none.
    """

    starts: _Ints
    targets: _Ints
    steps: NDArray[np.int64]


def legacy_trips(layout: Layout, trains: int, tries: int, state: State) -> Trips:
    """The trips of 2.2.2, each drawn until there is a way, but so many times at most."""
    trips = np.full((trains, FIELDS), NO_WAY, np.int32)
    draw_legacy_trips(layout.grid, layout.cities, layout.radius, tries, state, trips)
    return _apart(trips)


def stock_trips(layout: Layout, trains: int, state: State) -> Trips:
    """The trips of 4.3.0, whether there is a way or not."""
    trips = np.full((trains, FIELDS), NO_WAY, np.int32)
    draw_trips(layout.grid, layout.cities, layout.radius, state, trips)
    return _apart(trips)


def _apart(trips: _Ints) -> Trips:
    starts, targets = trips[:, : HEADING + 1].copy(), trips[:, TARGET_ROW : TARGET_COLUMN + 1].copy()
    return Trips(starts, targets, trips[:, STEPS].astype(np.int64))


@kernel
def _room_for_ways(grid: NDArray[np.uint16], cities: _Cities) -> _Ints:
    """[C * tracks + 1, H * W * 4]: the distances to each station, measured when first asked for; last, a queue."""
    most_tracks = 0
    for city in range(len(cities)):
        most_tracks = max(most_tracks, cities[city, TRACKS])
    ways = np.empty((len(cities) * most_tracks + 1, grid.size * 4), np.int32)
    for at in range(len(ways)):
        ways[at, 0] = _UNMEASURED
    return ways


@bare_kernel
def _measured_to(grid: NDArray[np.uint16], ways: _Ints, cities: _Cities, radius: int, city: int, track: int) -> int:
    """The row of `ways` with the distances to the station of a track."""
    number = city * (len(ways) // len(cities)) + track
    if ways[number, 0] == _UNMEASURED:
        row, column = station(cities[city], radius, track)
        measure(grid, row, column, ways[number], ways[len(ways) - 1])
    return number


@bare_kernel
def _note_stations(
    cities: _Cities, radius: int, home: tuple[int, int], away: tuple[int, int], trip: _Ints
) -> tuple[int, int]:
    """Note the stations of two tracks, each a city and a number, as start and target; row and column of the first."""
    row, column = station(cities[home[0]], radius, home[1])
    to_row, to_column = station(cities[away[0]], radius, away[1])
    trip[START_ROW], trip[START_COLUMN] = row, column
    trip[TARGET_ROW], trip[TARGET_COLUMN] = to_row, to_column
    return row, column


@kernel
def draw_legacy_trips(
    grid: NDArray[np.uint16], cities: _Cities, radius: int, tries: int, state: State, trips: _Ints
) -> None:
    """Draw trips of 2.2.2 into `trips` [N, FIELDS], which holds NO_WAY.

    Any two cities; from a track of even number to one of odd number; facing either way, turned if that leads
    nowhere.
    """
    ways, pair = _room_for_ways(grid, cities), np.empty(len(cities), np.int64)
    for train in range(len(trips)):
        for _ in range(tries):
            draw_pair(state, pair)
            home, away = pair[0], pair[1]
            from_track, to_track = draw_below(state, cities[home, TRACKS]), draw_below(state, cities[away, TRACKS])
            while from_track % 2 != 0:
                from_track = draw_below(state, cities[home, TRACKS])
            while to_track % 2 != 1:
                to_track = draw_below(state, cities[away, TRACKS])
            heading = (cities[home, SIDE] + 2 * draw_below(state, 2)) % 4
            steps = ways[_measured_to(grid, ways, cities, radius, away, to_track)]
            row, column = _note_stations(cities, radius, (home, from_track), (away, to_track), trips[train])
            place = 4 * (row * grid.shape[1] + column)
            if steps[place + heading] == NO_WAY:
                heading = (heading + 2) % 4
            trips[train, HEADING], trips[train, STEPS] = heading, steps[place + heading]
            if trips[train, STEPS] != NO_WAY:
                break
        if trips[train, STEPS] == NO_WAY:
            return


@kernel
def draw_trips(grid: NDArray[np.uint16], cities: _Cities, radius: int, state: State, trips: _Ints) -> None:
    """Draw trips of 4.3.0 into `trips` [N, FIELDS].

    Trains in pairs, the second of which goes back; facing either way, or north if neither leads anywhere.
    """
    ways, pair = _room_for_ways(grid, cities), np.empty(len(cities), np.int64)
    for train in range(len(trips)):
        if train % 2 == 0:
            draw_pair(state, pair)
        home, away = pair[train % 2], pair[1 - train % 2]
        from_track = 2 * draw_below(state, _DRAWN_STATIONS) % cities[home, TRACKS]
        to_track = (2 * draw_below(state, _DRAWN_STATIONS) + 1) % cities[away, TRACKS]
        steps = ways[_measured_to(grid, ways, cities, radius, away, to_track)]
        row, column = _note_stations(cities, radius, (home, from_track), (away, to_track), trips[train])
        place = 4 * (row * grid.shape[1] + column)
        one, other = cities[home, SIDE], (cities[home, SIDE] + 2) % 4
        leads, leads_too = steps[place + one] != NO_WAY, steps[place + other] != NO_WAY
        heading = one if leads else other if leads_too else 0
        if leads and leads_too and draw_below(state, 2) == 1:
            heading = other
        trips[train, HEADING], trips[train, STEPS] = heading, steps[place + heading]


@bare_kernel
def draw_classes(state: State, bounds: NDArray[np.float64], drawn: NDArray[np.int64]) -> None:
    """`drawn[:] = choice(len(bounds), len(drawn), p)`, with `bounds` the sums of all shares so far, the last one 1."""
    for at in range(len(drawn)):
        number = draw_uniform(state)
        drawn[at] = 0
        while bounds[drawn[at]] <= number:
            drawn[at] += 1


@bare_kernel
def draw_departures(state: State, ends: NDArray[np.int64], drawn: _Ints) -> None:
    """Draw a step below each of `ends`."""
    for at in range(len(ends)):
        drawn[at] = draw_below(state, ends[at])
