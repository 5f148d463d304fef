"""Levels of flatland-rl 4.3.0 as it is: its sparse rails and lines, and if wanted timetable, speeds, malfunctions.

For the `stock` rules; the study's own levels are those of `common.levels.legacy`. What comes out is what `RailEnv`
makes of the same seed, number for number. No `RailEnv` is built, and no distance map: most of its time goes into a
search for each train, here it is one for each target. Where the library has no room for two cities, see
`common.levels.room`.
"""

import random
import warnings
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flatland.envs.line_generators import SparseLineGen
from flatland.envs.rail_generators import SparseRailGen
from flatland.utils.seeding import np_random as flatland_rng
from numpy.random import RandomState
from numpy.typing import NDArray

from common.levels.distances import Distances
from common.levels.distributions import StockLevels
from common.levels.generate import InfeasibleLevelError
from common.levels.legacy import LEVEL_TRIES, broken_cells, forget_rails
from common.levels.level import Level, Malfunctions, Schedule
from common.levels.room import compact, room_of
from common.levels.speeds import speed_fraction
from common.seeding import stream_key

SEED_BITS = (1 << 32) - 1  # what the library's generator takes


def generate(levels: StockLevels, seed: int) -> Level:
    """The level of `seed`: a pure function, the same in every process, whatever the global generators hold.

    Raises:
        InfeasibleLevelError: none of `LEVEL_TRIES` derived seeds gave a level whose trains can all arrive.
    """
    for attempt in range(LEVEL_TRIES):
        derived = stream_key(seed, attempt, "stock-retry") & SEED_BITS if attempt else int(seed)
        state = random.getstate()  # the library seeds the interpreter's own generator
        try:
            level = _draw(levels, flatland_rng(derived)[0])  # type: ignore[no-untyped-call]
        finally:
            random.setstate(state)
            forget_rails()
        if level is not None:
            return level
    raise InfeasibleLevelError(f"no feasible level for seed {seed} in {LEVEL_TRIES} tries: make size or cities larger")


def shares_of(levels: StockLevels) -> Mapping[float, float] | None:
    """The speeds as the library's generator takes them: the fastest first, in whatever order they were given."""
    return None if levels.speeds is None else dict(sorted(levels.speeds.items(), reverse=True))


class _Rails(SparseRailGen):
    """4.3.0's sparse rails, in less time."""

    def _extract_stations_links(self, *_args: Any, **_kwargs: Any) -> Any:
        """Nobody asks for the named stations and links, and they take time."""

    def _fix_transitions(
        self, city_cells: Any, inter_city_lines: Any, grid_map: Any, vector_field: Any, np_random: Any
    ) -> None:
        """The library's, but broken cells are found in the whole grid at once."""
        broken = broken_cells(grid_map.grid, list(grid_map.transitions.transitions_all))
        for cell in [cell for cell in [*city_cells, *inter_city_lines] if broken[cell]]:
            self.fix_transitions(grid_map, (int(cell[0]), int(cell[1])), int(vector_field[cell]), np_random)


class _Lines(NamedTuple):
    """Who goes where.

    Attributes:
        starts: [N, 3], row, column, heading.
        targets: [N, 2], row, column.
        headings: [N], a bit for each heading that a train can have at its target.
        distances: steps from start to target.
        speeds: cells a step.
    """

    starts: NDArray[np.int32]
    targets: NDArray[np.int32]
    headings: NDArray[np.int32]
    distances: list[int]
    speeds: list[Fraction]


class _Times(NamedTuple):
    departures: NDArray[np.int32]  # [N]
    arrivals: NDArray[np.int32]  # [N]
    max_steps: int


def _draw(levels: StockLevels, rng: RandomState) -> Level | None:
    """The level that the next numbers of a generator make; None: a train cannot arrive."""
    height, width = levels.size
    room = room_of(levels)
    if room is None:
        raise InfeasibleLevelError(f"{height}x{width} has no room for two cities")
    rails = _Rails(
        max_num_cities=levels.cities,
        max_rails_between_cities=levels.rails_between_cities,
        max_rail_pairs_in_city=compact(room),
    )
    with warnings.catch_warnings():  # of cities and lines without a place; whether it matters is found below
        warnings.filterwarnings("ignore", category=UserWarning, module=r"flatland\.")
        drawn: Any = rails.generate(width, height, levels.trains, np_random=rng)
    rail, hints = drawn[0], drawn[1]["agents_hints"]
    lines = _lines(levels, rail, hints, rng)
    if lines is None:
        return None
    limit = int(8 * (width + height + levels.trains / len(hints["city_positions"])))
    times = _timetable(lines, limit, rng) if levels.timetable else _no_timetable(levels.trains, limit)
    breakdowns = levels.malfunctions
    return Level(
        grid=np.array(rail.grid, np.uint16),
        starts=lines.starts,
        targets=lines.targets,
        max_steps=times.max_steps,
        schedule=Schedule(
            speeds=np.array([speed.as_integer_ratio() for speed in lines.speeds], np.int32),
            earliest_departures=times.departures,
            latest_arrivals=times.arrivals,
            target_headings=lines.headings,
            malfunctions=None
            if breakdowns is None
            else Malfunctions(breakdowns.rate, breakdowns.min_steps, breakdowns.max_steps),
        ),
    )


def _lines(levels: StockLevels, rail: Any, hints: Any, rng: RandomState) -> _Lines | None:
    """The library's lines; None if one of them leads nowhere."""
    distances = Distances(rail.grid)
    rail.check_path_exists = distances.reaches  # the same answers, and a search a target instead of a train
    generator = SparseLineGen(shares_of(levels))  # type: ignore[arg-type]
    line: Any = generator.generate(rail, levels.trains, hints, np_random=rng)
    origins = [line.agent_waypoints[train][0][0] for train in range(levels.trains)]
    ends = [line.agent_waypoints[train][-1] for train in range(levels.trains)]
    if not all(ends):
        return None
    starts = np.array([(*at.position, int(at.direction)) for at in origins], np.int32)
    targets = np.array([end[0].position for end in ends], np.int32)
    ways = [
        distances.between((row, column), heading, target)
        for (row, column, heading), target in zip(starts.tolist(), targets.tolist(), strict=True)
    ]
    if min(ways) < 0:
        return None
    headings = np.array([sum(1 << int(way.direction) for way in end) for end in ends], np.int32)
    return _Lines(starts, targets, headings, ways, [speed_fraction(speed) for speed in line.agent_speeds])


def _no_timetable(trains: int, limit: int) -> _Times:
    return _Times(np.zeros(trains, np.int32), np.full(trains, limit, np.int32), limit)


def _timetable(lines: _Lines, limit: int, rng: RandomState) -> _Times:
    """`timetable_generator` of flatland-rl 4.3.0, for lines without stops: windows, and a step limit after them.

    Args:
        lines: who goes where.
        limit: the step limit of levels without a timetable.
        rng: of the level.
    """
    travel: Any = np.array([distance + 1 for distance in lines.distances]) / np.array(lines.speeds)  # of fractions
    delay = np.mean(travel) * 0.2
    max_steps = min(int(np.ceil(np.max(travel) * 1.5) + delay), int(limit * 3.0))
    last = max_steps - int(max_steps * 0.05)
    departures, arrivals = [], []
    for time in travel:
        longest = int(np.ceil((time * 1.3) + delay))
        departure = rng.randint(0, max(last - longest, 1))
        departures.append(departure)
        arrivals.append(departure + longest)
    return _Times(np.array(departures, np.int32), np.array(arrivals, np.int32), max_steps)
