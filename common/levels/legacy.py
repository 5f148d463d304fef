"""The levels of the study: flatland 2.2.2's distribution, drawn with the generators of flatland-rl 4.3.0.

Source: "Deep Reinforcement Learning in the Flatland Multi-Agent Environment" (2021), table 5.1, and the
sparse rail and schedule generators of flatland-rl 2.2.2. Where 4.3.0 differs (tracks in a city, placement of
cities, the lines between them, the order of repairs, who goes where), the old rule is restated here; all else is the
library's. The same random numbers give the same levels as in 2.2.2. No `RailEnv`, timetable or distance map is built.
"""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, SupportsIndex

import numpy as np
from flatland.envs.rail_generators import SparseRailGen
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.utils.seeding import np_random as flatland_rng
from numpy.random import RandomState
from numpy.typing import NDArray

from common.levels.distances import Distances
from common.levels.distributions import LegacyLevels
from common.levels.generate import InfeasibleLevelError
from common.levels.level import Level
from common.levels.lines import find_line, lay_line
from common.levels.room import Room, compact, room_of
from common.rail.decisions import STEPS, exits
from common.seeding import stream_key

CITY_TRIES = 201  # 2.2.2 gave up on a city after so many places
ROUTE_TRIES = 100  # and on a train after so many pairs of stations
LEVEL_TRIES = 20

_Cell = tuple[int, int]
_Station = tuple[_Cell, int]  # the middle of a track, and the number of the track in its city


def generate(levels: LegacyLevels, seed: int) -> Level:
    """The level of `seed`: a pure function, the same in every process, whatever the global generators hold.

    Raises:
        InfeasibleLevelError: none of `LEVEL_TRIES` derived seeds gave a feasible level.
    """
    for attempt in range(LEVEL_TRIES):
        derived = stream_key(int(seed), attempt, "level-retry") if attempt else int(seed)
        try:
            return _draw(levels, flatland_rng(derived)[0])  # type: ignore[no-untyped-call]
        except InfeasibleLevelError:
            continue
        finally:
            forget_rails()
    raise InfeasibleLevelError(f"no feasible level for seed {seed} in {LEVEL_TRIES} tries: make size or cities larger")


def max_episode_steps(height: int, width: int, trains: int, cities_placed: int) -> int:
    """The step limit of 2.2.2, which grows when a city found no place."""
    return int(8 * (height + width + trains / cities_placed))


def _draw(levels: LegacyLevels, rng: RandomState) -> Level:
    height, width = levels.size
    room = room_of(levels)
    if room is None:
        raise InfeasibleLevelError(f"{height}x{width} has no room for two cities")
    with warnings.catch_warnings():  # of lines that could not be drawn; whether it matters is found below
        warnings.filterwarnings("ignore", category=UserWarning, module=r"flatland\.")
        drawn: Any = _LegacyRails(levels, room).generate(width, height, levels.trains, np_random=rng)
    rail, hints = drawn[0], drawn[1]["agents_hints"]
    rail.check_path_exists = Distances(rail.grid).reaches  # the same answers, and a search a target instead of a train
    routes = [_route(rail, hints, rng) for _ in range(levels.trains)]
    return Level(
        grid=np.array(rail.grid, dtype=np.uint16),
        starts=np.array([start for start, _ in routes], dtype=np.int32),
        targets=np.array([target for _, target in routes], dtype=np.int32),
        max_steps=max_episode_steps(height, width, levels.trains, len(hints["city_positions"])),
    )


def forget_rails() -> None:
    """Empty the library's caches, which are keyed on the map and would keep every map ever drawn."""
    for cached in _MAP_CACHES:
        cached()


_MAP_CACHES: list[Callable[[], None]] = [
    member.cache_clear
    for owner in RailGridTransitionMap.__mro__
    for member in vars(owner).values()
    if hasattr(member, "cache_clear")
]


def _route(rail: Any, hints: dict[str, Any], rng: RandomState) -> tuple[tuple[int, int, int], _Cell]:
    """The start and target of a train, as 2.2.2's schedule generator drew them.

    Any two cities; from a track of even number to one of odd number; facing either way, turned if that leads
    nowhere.
    """
    stations, orientations = hints["train_stations"], hints["city_orientations"]
    for _ in range(ROUTE_TRIES):
        home, away = rng.choice(len(stations), 2, replace=False)
        start, target = _station(stations[home], rng), _station(stations[away], rng)
        while start[1] % 2 != 0:
            start = _station(stations[home], rng)
        while target[1] % 2 != 1:
            target = _station(stations[away], rng)
        (row, column), goal = start[0], target[0]
        heading = int(rng.choice([orientations[home], (orientations[home] + 2) % 4]))
        for facing in (heading, (heading + 2) % 4):
            if rail.check_path_exists((row, column), facing, goal):
                return (int(row), int(column), facing), (int(goal[0]), int(goal[1]))
    raise InfeasibleLevelError(f"no pair of stations is connected in {ROUTE_TRIES} draws")


def _station(stations: list[_Station], rng: RandomState) -> _Station:
    return stations[rng.choice(len(stations))]


class _Tracks(int):
    """A number of tracks; the library's `* 2`, which makes pairs of it, leaves it as it is."""

    def __mul__(self, _other: SupportsIndex) -> int:
        return int(self)


class _TrackDraws:
    """The draws of `_generate_city_connection_points`, two a city: its tracks, then its ways out."""

    def __init__(self, rng: RandomState, most_tracks: int) -> None:
        self._rng = rng
        self._most_tracks = most_tracks
        self._draws = 0

    def randint(self, low: int, high: int) -> int:
        self._draws += 1
        if self._draws % 2 == 1:
            return _Tracks(self._rng.randint(2, self._most_tracks + 1))
        return int(self._rng.randint(low, high))


class _LegacyRails(SparseRailGen):
    """4.3.0's sparse rails as 2.2.2 drew them: cities of two or more tracks, placed by rejection, and its lines."""

    def __init__(self, levels: LegacyLevels, room: Room) -> None:
        super().__init__(
            max_num_cities=levels.cities,
            grid_mode=False,
            max_rails_between_cities=levels.rails_between_cities,
            max_rail_pairs_in_city=compact(room),
            backwards_compatibility_mode=True,  # no draw for crossings on two levels
        )
        self._most_tracks = min(levels.rails_in_city, 2 * room.rail_pairs)
        self._cells_of_cities: list[_Cell] = []

    def _generate_random_city_positions(
        self, num_cities: int, city_radius: int, width: int, height: int, np_random: Any = None
    ) -> Any:
        """4.3.0 samples the free cells exhaustively, which places three cities more often than 2.2.2 did."""
        margin = city_radius + 1
        cities: list[_Cell] = []
        for _ in range(num_cities):
            for _try in range(CITY_TRIES):
                row = margin + int(np_random.randint(height - 2 * margin))
                column = margin + int(np_random.randint(width - 2 * margin))
                if all(abs(row - r) > 2 * margin or abs(column - c) > 2 * margin for r, c in cities):
                    cities.append((row, column))
                    break
        if len(cities) < 2:  # what the library does next, with a warning
            return self._generate_evenly_distr_city_positions(num_cities, city_radius, width, height)
        return cities

    def _generate_city_connection_points(self, *args: Any, **kwargs: Any) -> Any:
        kwargs["np_random"] = _TrackDraws(kwargs["np_random"], self._most_tracks)
        return super()._generate_city_connection_points(*args, **kwargs)

    def _get_cells_in_city(self, center: Any, radius: int, city_orientation: int, vector_field: Any) -> Any:
        """The library's, but it remembers their order: 4.3.0 puts them into a set."""
        cells: Any = super()._get_cells_in_city(center, radius, city_orientation, vector_field)
        self._cells_of_cities += sorted((int(row), int(column)) for row, column in cells)
        return cells

    def _connect_cities(
        self,
        city_positions: Any,
        connection_points: Any,
        city_cells: Any,
        rail_trans: Any,  # noqa: ARG002
        grid_map: Any,
    ) -> Any:
        """Lines from all points of a city to the nearest point of the neighbour on that side (see `levels.lines`)."""
        grid = grid_map.grid
        blocked = np.zeros(grid.shape, dtype=np.bool_)
        blocked[tuple(np.array(list(city_cells)).T)] = True
        lines = []
        for city in range(len(city_positions)):
            neighbours = self._closest_neighbour_in_grid4_directions(city, city_positions)
            for side in range(4):
                nearest: Any = self.get_closest_neighbour_for_direction(neighbours, side)  # type: ignore[no-untyped-call]
                points = [point for points in connection_points[nearest] for point in points]
                for point in connection_points[city][side]:
                    end = min(points, key=partial(_manhattan, point))
                    line = find_line(grid, blocked, _number(grid, point), _number(grid, end))
                    if len(line) == 0:
                        continue
                    lay_line(grid, line)
                    lines.append([(int(cell) // grid.shape[1], int(cell) % grid.shape[1]) for cell in line])
        return lines

    def _fix_transitions(
        self,
        city_cells: Any,  # noqa: ARG002  (the same cells in another order)
        inter_city_lines: Any,
        grid_map: Any,
        vector_field: Any,
        np_random: Any,
    ) -> None:
        """The library's, but broken cells are found in the whole grid at once: that was most of the time."""
        broken = broken_cells(grid_map.grid, list(grid_map.transitions.transitions_all))
        for cell in [cell for cell in [*self._cells_of_cities, *inter_city_lines] if broken[cell]]:
            self.fix_transitions(grid_map, (int(cell[0]), int(cell[1])), int(vector_field[cell]), np_random)

    def _extract_stations_links(self, *_args: Any, **_kwargs: Any) -> Any:
        """Nobody asks for the named stations and links, and they take time."""


def _manhattan(here: _Cell, there: _Cell) -> int:
    return int(abs(here[0] - there[0]) + abs(here[1] - there[1]))


def _number(grid: NDArray[np.uint16], cell: _Cell) -> int:
    return int(cell[0]) * grid.shape[1] + int(cell[1])


def broken_cells(grid: NDArray[np.uint16], pieces: list[int]) -> NDArray[np.bool_]:
    """[H, W]: not `cell_neighbours_valid(cell, check_this_cell=True)`.

    A cell is broken if it is no piece of rail, leads off the grid or to a cell that cannot be entered so, or
    is empty although a neighbour leads to it.
    """
    height, width = grid.shape
    ways = exits(grid)
    leads = np.zeros((height + 2, width + 2, 4), dtype=bool)  # with a border that is empty
    enters = leads.copy()
    leads[1:-1, 1:-1] = ways.any(axis=2)  # by exit
    enters[1:-1, 1:-1] = ways.any(axis=3)  # by heading
    broken: NDArray[np.bool_] = ~np.isin(grid, pieces)
    for heading, (down, right) in enumerate(STEPS):
        there = (slice(1 + down, 1 + down + height), slice(1 + right, 1 + right + width))
        broken |= leads[1:-1, 1:-1, heading] & ~enters[(*there, heading)]
        broken |= (grid == 0) & leads[(*there, (heading + 2) % 4)]
    return broken
