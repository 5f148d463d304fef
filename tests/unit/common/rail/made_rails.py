"""Small levels by hand, and schedules for levels."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from railctl.common.levels.level import Level, Malfunctions, Schedule

NORTH, EAST, SOUTH, WEST = range(4)
ALONG, ACROSS = 0x0401, 0x8020
WEST_END, EAST_END = 0x0004, 0x0100
NORTH_WEST, NORTH_EAST, SOUTH_EAST, SOUTH_WEST = 0x4002, 0x1200, 0x0810, 0x0048  # corners of a ring, where they lie
EAST_TO_NORTH = 0x0400 | 0x0001 | 0x0800 | 0x0010  # a line along, from which trains to the east may turn north
WEST_TO_NORTH = 0x0400 | 0x0001 | 0x0008 | 0x0040
EAST_TO_BOTH = 0x0800 | 0x0200 | 0x0010 | 0x1000  # trains to the east turn north or south, those come out to the west


def line(*trains: tuple[int, int, int], max_steps: int = 20) -> Level:
    """A line of seven cells; each train is start column, heading, target column."""
    return Level(
        grid=np.array([[WEST_END, ALONG, ALONG, ALONG, ALONG, ALONG, EAST_END]], np.uint16),
        starts=np.array([[0, start, heading] for start, heading, _ in trains], np.int32),
        targets=np.array([[0, target] for _, _, target in trains], np.int32),
        max_steps=max_steps,
    )


def passing_loop(*trains: tuple[int, int, int], max_steps: int = 20) -> Level:
    """As `line`, with a way around its middle cell on the row to the north."""
    level = line(*trains, max_steps=max_steps)
    grid = np.array(
        [
            [0, 0, NORTH_WEST, ALONG, NORTH_EAST, 0, 0],
            [WEST_END, ALONG, EAST_TO_NORTH, ALONG, WEST_TO_NORTH, ALONG, EAST_END],
        ],
        np.uint16,
    )
    return replace(
        level,
        grid=grid,
        starts=level.starts + np.array([1, 0, 0], np.int32),
        targets=level.targets + np.array([1, 0], np.int32),
    )


def fork(target: int, *, max_steps: int = 40) -> Level:
    """A line that only branches to both sides in its last cell; a train goes there, and on to the row of its target."""
    return Level(
        grid=np.array(
            [[0, 0, NORTH_WEST, EAST_END], [WEST_END, ALONG, EAST_TO_BOTH, 0], [0, 0, SOUTH_WEST, EAST_END]], np.uint16
        ),
        starts=np.array([[1, 1, EAST]], np.int32),
        targets=np.array([[target, 3]], np.int32),
        max_steps=max_steps,
    )


def ring(side: int, *trains: tuple[int, int, int], max_steps: int = 60) -> Level:
    """A ring along the edge of a square grid; each train is start row, column, heading, clockwise; targets follow."""
    grid = np.zeros((side, side), np.uint16)
    grid[[0, -1], 1:-1], grid[1:-1, 0], grid[1:-1, -1] = ALONG, ACROSS, ACROSS
    grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0] = NORTH_WEST, NORTH_EAST, SOUTH_EAST, SOUTH_WEST
    starts = np.array(trains, np.int32)
    return Level(grid, starts, np.roll(starts[:, :2], 1, axis=0), max_steps)


def scheduled(
    level: Level,
    *,
    speeds: Sequence[tuple[int, int]] | None = None,
    departures: Sequence[int] | None = None,
    arrivals: Sequence[int] | None = None,
    headings: Sequence[int] | None = None,
    malfunctions: Malfunctions | None = None,
) -> Level:
    """The level with a schedule; what is not given is as in the study."""
    n_trains = level.n_trains
    schedule = Schedule(
        speeds=np.array(speeds or [(1, 1)] * n_trains, np.int32),
        earliest_departures=np.array(departures or [0] * n_trains, np.int32),
        latest_arrivals=np.array(arrivals or [level.max_steps] * n_trains, np.int32),
        target_headings=np.array(headings or [0] * n_trains, np.int32),
        malfunctions=malfunctions,
    )
    return replace(level, schedule=schedule)
