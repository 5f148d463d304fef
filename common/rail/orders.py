"""What the trains of a level are told beyond start and target, as both engines take it."""

from functools import cache
from math import gcd, lcm
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level, Schedule

LARGEST_UNIT = 1 << 20
ALL_HEADINGS = 15


class Orders(NamedTuple):
    """The orders of N trains.

    Attributes:
        unit: speeds are multiples of 1 / unit.
        trains: [N, 4] int32: full speed, earliest departure, a bit for each heading that counts at the target, latest
            arrival; no bit at all stands for all headings that the rails allow.
    """

    unit: int
    trains: NDArray[np.int32]


def orders_of(level: Level, *, legacy: bool) -> Orders:
    """The orders of a level.

    Raises:
        ValueError: they are no orders for its trains, or none that the rules know; in one line.
    """
    schedule, n_trains = level.schedule, level.n_trains
    if schedule is None:
        return Orders(1, _plain(n_trains, level.max_steps))
    speeds = np.asarray(schedule.speeds, np.int64)
    columns = schedule.earliest_departures, schedule.target_headings, schedule.latest_arrivals
    if speeds.shape != (n_trains, 2) or any(np.shape(column) != (n_trains,) for column in columns):
        raise ValueError(f"the schedule is not one of {n_trains} trains: give each a speed, windows and headings")
    if not ((speeds[:, 0] > 0) & (speeds[:, 0] <= speeds[:, 1])).all():
        raise ValueError("a train's speed is not above 0 and at most 1: correct the schedule's speeds")
    if legacy and not is_plain(level, schedule):
        raise ValueError("the rules of 2.2.2 know speed 1 only, no timetables and no malfunctions: use stock rules")
    unit = lcm(*(denominator // gcd(numerator, denominator) for numerator, denominator in speeds.tolist()))
    if unit > LARGEST_UNIT:
        raise ValueError(f"speeds with a common denominator above {LARGEST_UNIT} are not supported: make them rounder")
    full_speeds = speeds[:, 0] * unit // speeds[:, 1]
    return Orders(unit, np.stack((full_speeds, *columns), axis=1).astype(np.int32))


def is_plain(level: Level, schedule: Schedule) -> bool:
    """Whether a schedule orders what the rules of 2.2.2 do anyway; latest arrivals bind nobody."""
    speeds, headings = np.asarray(schedule.speeds), np.asarray(schedule.target_headings)
    if (
        schedule.malfunctions is not None
        or np.any(schedule.earliest_departures)
        or (speeds[:, 0] != speeds[:, 1]).any()
    ):
        return False
    usable = usable_headings(level)
    return bool(((headings == 0) | (headings & usable == usable)).all())


def usable_headings(level: Level) -> NDArray[np.int32]:
    """[N]: a bit for each heading (bit 0 north) with which a train can be on its target and leave it."""
    cells = level.grid[level.targets[:, 0], level.targets[:, 1]].astype(np.int32)
    headings = np.arange(4)
    ways = cells[:, None] >> (12 - 4 * headings) & ALL_HEADINGS
    usable: NDArray[np.int32] = ((ways != 0) << headings).sum(axis=1).astype(np.int32)
    return usable


@cache
def _plain(n_trains: int, max_steps: int) -> NDArray[np.int32]:
    """What the study orders."""
    return np.tile(np.array([1, 0, 0, max_steps], np.int32), (n_trains, 1))
