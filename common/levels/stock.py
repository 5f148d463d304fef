"""Levels of flatland-rl 4.3.0 as it is: its sparse rails and lines, and if wanted timetable, speeds, malfunctions.

For the `stock` rules; the study's own levels are those of `common.levels.legacy`. What comes out is what `RailEnv`
makes of the same seed, number for number, in compiled code (`common.levels.compiled`). Where the library has no room
for two cities, see `common.levels.room`.
"""

from collections.abc import Mapping
from fractions import Fraction
from functools import cache
from math import lcm
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.compiled.layout import draw_layout
from railctl.common.levels.compiled.trips import draw_classes, draw_departures, stock_trips
from railctl.common.levels.compiled.twister import State, draw_uniform, seeded
from railctl.common.levels.distributions import StockLevels
from railctl.common.levels.legacy import LEVEL_TRIES
from railctl.common.levels.level import InfeasibleLevelError, Level, Malfunctions, Schedule
from railctl.common.levels.room import room_of
from railctl.common.levels.speeds import speed_fraction
from railctl.common.seeding import stream_key

SEED_BITS = (1 << 32) - 1  # what the library's generator takes


def generate(levels: StockLevels, seed: int) -> Level:
    """The level of `seed`: a pure function, the same in every process, whatever the global generators hold.

    Raises:
        InfeasibleLevelError: none of `LEVEL_TRIES` derived seeds gave a level whose trains can all arrive.
        TracksLeaveGridError: tracks reach beyond the grid.
    """
    for attempt in range(LEVEL_TRIES):
        derived = stream_key(seed, attempt, "stock-retry") & SEED_BITS if attempt else int(seed)
        level = _draw(levels, seeded(derived))
        if level is not None:
            return level
    raise InfeasibleLevelError(f"no feasible level for seed {seed} in {LEVEL_TRIES} tries: make size or cities larger")


def shares_of(levels: StockLevels) -> Mapping[float, float] | None:
    """The speeds as the library's generator takes them: the fastest first, in whatever order they were given."""
    return None if levels.speeds is None else dict(sorted(levels.speeds.items(), reverse=True))


class _Speeds(NamedTuple):
    """What trains may run at.

    Attributes:
        fractions: [K, 2], cells a step as numerator and denominator.
        bounds: [K], the shares of a speed and all before it.
    """

    fractions: NDArray[np.int32]
    bounds: NDArray[np.float64]


class _Times(NamedTuple):
    departures: NDArray[np.int32]  # [N]
    arrivals: NDArray[np.int32]  # [N]
    max_steps: int


@cache
def _speeds(shares: tuple[tuple[float, float], ...]) -> _Speeds:
    bounds = np.array([share for _, share in shares]).cumsum()
    return _Speeds(
        np.array([speed_fraction(speed).as_integer_ratio() for speed, _ in shares], np.int32), bounds / bounds[-1]
    )


def _draw(levels: StockLevels, state: State) -> Level | None:
    """The level that the next numbers of a generator make; None: a train cannot arrive."""
    height, width = levels.size
    room = room_of(levels)
    if room is None:
        raise InfeasibleLevelError(f"{height}x{width} has no room for two cities")
    layout = draw_layout(levels, room, state)
    draw_uniform(state)  # the share of crossings on two levels, of which there are none
    trips = stock_trips(layout, levels.trains, state)
    headings = _headings(layout.grid, trips.targets)
    if trips.steps.min() < 0 or not headings.all():
        return None
    fractions, bounds = _speeds(tuple((shares_of(levels) or {1.0: 1.0}).items()))
    classes = np.zeros(levels.trains, np.int64)
    if levels.speeds is not None:
        draw_classes(state, bounds, classes)
    limit = int(8 * (width + height + levels.trains / len(layout.cities)))
    if levels.timetable:
        times = _timetable(trips.steps + 1, fractions[classes].astype(np.int64), limit, state)
    else:
        times = _no_timetable(levels.trains, limit)
    breakdowns = levels.malfunctions
    return Level(
        grid=layout.grid,
        starts=trips.starts,
        targets=trips.targets,
        max_steps=times.max_steps,
        schedule=Schedule(
            speeds=fractions[classes],
            earliest_departures=times.departures,
            latest_arrivals=times.arrivals,
            target_headings=headings,
            malfunctions=None
            if breakdowns is None
            else Malfunctions(breakdowns.rate, breakdowns.min_steps, breakdowns.max_steps),
        ),
    )


def _headings(grid: NDArray[np.uint16], targets: NDArray[np.int32]) -> NDArray[np.int32]:
    """[N]: a bit for each heading that a train can have at its target."""
    pieces = grid[targets[:, 0], targets[:, 1]].astype(np.int32)
    headings = np.zeros(len(targets), np.int32)
    for heading in range(4):
        headings |= ((pieces >> (12 - 4 * heading) & 15) != 0).astype(np.int32) << heading
    return headings


def _no_timetable(trains: int, limit: int) -> _Times:
    return _Times(np.zeros(trains, np.int32), np.full(trains, limit, np.int32), limit)


def _timetable(cells: NDArray[np.int64], speeds: NDArray[np.int64], limit: int, state: State) -> _Times:
    """`timetable_generator` of flatland-rl 4.3.0, for lines without stops: windows, and a step limit after them.

    The library computes with fractions and rounds at the end; here only their mean has to.

    Args:
        cells: [N], from start to target, both included.
        speeds: [N, 2], numerators and denominators.
        limit: the step limit of levels without a timetable.
        state: of the generator.
    """
    travel = cells * speeds[:, 1] / speeds[:, 0]
    delay = _mean(cells, speeds) * 0.2
    max_steps = min(int(np.ceil(travel.max() * 1.5) + delay), int(limit * 3.0))
    last = max_steps - int(max_steps * 0.05)
    longest = np.ceil(travel * 1.3 + delay).astype(np.int64)
    departures = np.empty(len(cells), np.int32)
    draw_departures(state, np.maximum(last - longest, 1), departures)
    return _Times(departures, (departures + longest).astype(np.int32), max_steps)


def _mean(cells: NDArray[np.int64], speeds: NDArray[np.int64]) -> float:
    """Of the times that cells take: the number nearest to the exact one."""
    unit = lcm(*speeds[:, 0].tolist())
    total = sum(
        cell * (bottom * (unit // top)) for cell, (top, bottom) in zip(cells.tolist(), speeds.tolist(), strict=True)
    )
    return float(Fraction(total, unit * len(cells)))
