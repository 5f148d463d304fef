"""Levels as flatland-rl's own generators make them, slowly: what compiled ones are compared with.

`legacy_level` is the distribution of 2.2.2, drawn with the generators of 4.3.0. Where those differ (tracks in a city,
placement of cities, the lines between them, the order of repairs, who goes where), the old rule is restated here; all
else is the library's. `stock_level` is what a `RailEnv` of 4.3.0 has after its reset.
"""

import random
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from flatland.envs.rail_generators import SparseRailGen
from flatland.utils.seeding import np_random as flatland_rng
from numpy.random import RandomState

from railctl.common.levels.compiled.lines import lay_line
from railctl.common.levels.distributions import LegacyLevels, StockLevels
from railctl.common.levels.level import Level, Schedule
from railctl.common.levels.room import Room, room_of
from railctl.tools.levels.library import forget_rails, library_environment

CITY_TRIES, ROUTE_TRIES = 201, 100

Cell = tuple[int, int]


class CompactPairs(int):
    """Pairs of rails in a city, for `SparseRailGen`: it takes a smaller radius for its cities than it otherwise would.

    It computes the radius as half of `pairs * 2`, plus its padding.
    """

    spared = 0

    def __mul__(self, other: int) -> int:
        rails = _Rails(int(self) * int(other))
        rails.radius = int(self) - self.spared
        return rails


class _Rails(int):
    radius = 0

    def __truediv__(self, _two: int) -> int:
        return self.radius


def pairs_of(room: Room) -> int:
    """The pairs of rails, as `SparseRailGen` is given them."""
    pairs = CompactPairs(room.rail_pairs)
    pairs.spared = room.spared
    return pairs


@contextmanager
def kept_state() -> Iterator[None]:
    """The library seeds the interpreter's own generator and keeps every map in its caches."""
    state = random.getstate()
    try:
        yield
    finally:
        random.setstate(state)
        forget_rails()


def stock_level(levels: StockLevels, seed: int) -> Level | None:
    """The level of a seed; None if the library's draw has a train that cannot arrive."""
    with kept_state():
        env: Any = library_environment(levels, seed)
        env.rail_generator.max_rail_pairs_in_city = pairs_of(room_of(levels))
        env.reset(random_seed=seed)
        distances = env.distance_map.get()
    agents = env.agents
    starts = np.array(
        [(*agent.initial_configuration[0], int(agent.initial_configuration[1])) for agent in agents], np.int32
    )
    if not all(np.isfinite(distances[train, *start]) for train, start in enumerate(starts.tolist())):
        return None
    headings = [sum(1 << int(heading) for _, heading in agent.targets) for agent in agents]
    return Level(
        grid=np.array(env.rail.grid, np.uint16),
        starts=starts,
        targets=np.array([next(iter(agent.targets))[0] for agent in agents], np.int32),
        max_steps=env._max_episode_steps,
        schedule=Schedule(
            speeds=np.array([agent.speed_counter.max_speed.as_integer_ratio() for agent in agents], np.int32),
            earliest_departures=np.array([agent.earliest_departure for agent in agents], np.int32),
            latest_arrivals=np.array([agent.latest_arrival for agent in agents], np.int32),
            target_headings=np.array(headings, np.int32),
        ),
    )


def legacy_level(levels: LegacyLevels, seed: int) -> Level | None:
    """The level of a seed; None if a train finds no way."""
    height, width = levels.size
    room = room_of(levels)
    with kept_state():
        rng = flatland_rng(seed)[0]
        rail, products = LegacyRails(levels, room).generate(width, height, levels.trains, np_random=rng)
        hints = products["agents_hints"]
        routes = [_route(rail, hints, rng) for _ in range(levels.trains)]
    if None in routes:
        return None
    return Level(
        grid=np.array(rail.grid, np.uint16),
        starts=np.array([start for start, _ in routes], np.int32),
        targets=np.array([target for _, target in routes], np.int32),
        max_steps=int(8 * (height + width + levels.trains / len(hints["city_positions"]))),
    )


def _route(rail: Any, hints: dict[str, Any], rng: RandomState) -> tuple[tuple[int, int, int], Cell] | None:
    stations, orientations = hints["train_stations"], hints["city_orientations"]

    def station(city: int) -> tuple[Cell, int]:
        return stations[city][rng.choice(len(stations[city]))]

    for _ in range(ROUTE_TRIES):
        home, away = rng.choice(len(stations), 2, replace=False)
        start, target = station(home), station(away)
        while start[1] % 2 != 0:
            start = station(home)
        while target[1] % 2 != 1:
            target = station(away)
        heading = int(rng.choice([orientations[home], (orientations[home] + 2) % 4]))
        for facing in (heading, (heading + 2) % 4):
            if rail.check_path_exists(start[0], facing, target[0]):
                return (*start[0], facing), target[0]
    return None


class _Tracks(int):
    """A number of tracks; the library's `* 2`, which makes pairs of it, leaves it as it is."""

    def __mul__(self, _other: int) -> int:
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


class LegacyRails(SparseRailGen):
    """4.3.0's sparse rails as 2.2.2 drew them: cities of two or more tracks, placed by rejection, and its lines."""

    def __init__(self, levels: LegacyLevels, room: Room) -> None:
        super().__init__(
            max_num_cities=levels.cities,
            max_rails_between_cities=levels.rails_between_cities,
            max_rail_pairs_in_city=pairs_of(room),
            backwards_compatibility_mode=True,  # no draw for crossings on two levels
        )
        self._most_tracks = min(levels.rails_in_city, 2 * room.rail_pairs)
        self._cells_of_cities: list[Cell] = []

    def _generate_random_city_positions(
        self, num_cities: int, city_radius: int, width: int, height: int, np_random: Any = None
    ) -> Any:
        """4.3.0 samples the free cells exhaustively, which places three cities more often than 2.2.2 did."""
        margin = city_radius + 1
        cities: list[Cell] = []
        for _ in range(num_cities):
            for _try in range(CITY_TRIES):
                row = margin + int(np_random.randint(height - 2 * margin))
                column = margin + int(np_random.randint(width - 2 * margin))
                if all(abs(row - r) > 2 * margin or abs(column - c) > 2 * margin for r, c in cities):
                    cities.append((row, column))
                    break
        return cities

    def _generate_city_connection_points(self, *args: Any, **kwargs: Any) -> Any:
        kwargs["np_random"] = _TrackDraws(kwargs["np_random"], self._most_tracks)
        return super()._generate_city_connection_points(*args, **kwargs)

    def _get_cells_in_city(self, center: Any, radius: int, city_orientation: int, vector_field: Any) -> Any:
        """The library's, but it remembers their order: 4.3.0 puts them into a set."""
        cells: Any = super()._get_cells_in_city(center, radius, city_orientation, vector_field)
        self._cells_of_cities += sorted(cells)
        return cells

    def _connect_cities(
        self, city_positions: Any, connection_points: Any, city_cells: Any, _rail_trans: Any, grid_map: Any
    ) -> Any:
        """The library's, but for the search."""
        lines = []
        for city in range(len(city_positions)):
            neighbours = self._closest_neighbour_in_grid4_directions(city, city_positions)
            for side in range(4):
                nearest: Any = self.get_closest_neighbour_for_direction(neighbours, side)
                points = [point for points in connection_points[nearest] for point in points]
                for point in connection_points[city][side]:
                    line = find_legacy_line(grid_map.grid, city_cells, point, min(points, key=partial(_apart, point)))
                    if line:
                        numbers = np.array([row * grid_map.width + column for row, column in line])
                        lay_line.py_func(grid_map.grid, numbers, len(numbers))
                    lines.append(line)
        return lines

    def _fix_transitions(self, _cells: Any, lines: Any, grid_map: Any, vector_field: Any, rng: Any) -> None:
        super()._fix_transitions(self._cells_of_cities, lines, grid_map, vector_field, rng)

    def _extract_stations_links(self, *_args: Any, **_kwargs: Any) -> None:
        """Nobody asks for the named stations and links."""


def _apart(here: Cell, there: Cell) -> int:
    return int(abs(here[0] - there[0]) + abs(here[1] - there[1]))


def find_legacy_line(grid: np.ndarray, blocked: set[Cell], start: Cell, end: Cell) -> list[Cell]:
    """`a_star` of 2.2.2: of the open nodes with the least estimate the one that was found first is looked at."""
    parents: dict[Cell, Cell | None] = {start: None}
    steps, open_nodes = {start: 0}, {start: 0}  # with their estimates, in the order in which they were found
    while open_nodes:
        cell = min(open_nodes, key=open_nodes.__getitem__)
        del open_nodes[cell]
        if cell == end:
            line: list[Cell] = []
            at: Cell | None = cell
            while at is not None:
                line.append(at)
                at = parents[at]
            return line[::-1]
        for down, right in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            child = (cell[0] + down, cell[1] + right)
            if not (0 <= child[0] < grid.shape[0] and 0 <= child[1] < grid.shape[1]) or child in parents:
                continue
            if child in blocked and child not in (start, end):
                continue
            parents[child], steps[child] = cell, steps[cell] + 1
            open_nodes[child] = steps[child] + _apart(child, end) + int(grid[child] != 0)
    return []
