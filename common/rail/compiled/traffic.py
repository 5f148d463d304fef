"""What flatland-rl 4.3.0 knows of trains beyond a `Level`: speeds, timetables, malfunctions, headings at targets."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import lcm

import numpy as np
from numpy.typing import NDArray

from common.rail.compiled.malfunctions import Malfunctions

LARGEST_UNIT = 1 << 20


@dataclass(frozen=True)
class Traffic:
    """How the trains of a level run; what is None is as in the study.

    Attributes:
        speeds: the full speed of each train, in cells a step, above 0 and at most 1.
        departures: the earliest departure of each train.
        target_headings: for each train, the headings that count as arrived; those without rails do not.
        malfunctions: what breaks trains down.
    """

    speeds: Sequence[Fraction] | None = None
    departures: Sequence[int] | None = None
    target_headings: Sequence[Sequence[int]] | None = None
    malfunctions: Malfunctions | None = None

    @property
    def is_plain(self) -> bool:
        """All trains are of speed 1, may depart at once and never break down."""
        slow = any(speed != 1 for speed in self.speeds or ())
        return not slow and not any(self.departures or ()) and self.malfunctions is None

    def orders(self, n_trains: int) -> tuple[NDArray[np.int32], int]:
        """[N, 3]: full speed, earliest departure, a bit for each heading that counts at the target; and the unit.

        Speeds are multiples of 1 / unit; no bit at all stands for all headings that the rails allow.
        """
        if self is STUDY:
            return plain_orders(n_trains), 1
        speeds, unit = self.integer_speeds(n_trains)
        return np.stack((speeds, self.departure_times(n_trains), self.target_masks(n_trains)), axis=1), unit

    def integer_speeds(self, n_trains: int) -> tuple[NDArray[np.int32], int]:
        """[N] full speeds as multiples of 1 / unit, and the unit."""
        if self.speeds is None:
            return np.ones(n_trains, np.int32), 1
        speeds = self.speeds
        if len(speeds) != n_trains or not all(0 < speed <= 1 for speed in speeds):
            raise ValueError(f"{n_trains} trains need as many speeds, above 0 and at most 1: {speeds}")
        unit = lcm(*(speed.denominator for speed in speeds))
        if unit > LARGEST_UNIT:
            raise ValueError(f"speeds with a common denominator above {LARGEST_UNIT} are not supported: {speeds}")
        return np.array([int(speed * unit) for speed in speeds], np.int32), unit

    def departure_times(self, n_trains: int) -> NDArray[np.int32]:
        """[N]."""
        if self.departures is None:
            return np.zeros(n_trains, np.int32)
        times = np.array(self.departures, np.int32)
        if times.shape != (n_trains,):
            raise ValueError(f"{n_trains} trains need as many departures: {self.departures}")
        return times

    def target_masks(self, n_trains: int) -> NDArray[np.int32]:
        """[N]: a bit a heading, 0 for all."""
        if self.target_headings is None:
            return np.zeros(n_trains, np.int32)
        headings = self.target_headings
        if len(headings) != n_trains:
            raise ValueError(f"{n_trains} trains need as many lists of headings at targets: {headings}")
        return np.array([sum(1 << heading for heading in set(some)) for some in headings], np.int32)


@cache
def plain_orders(n_trains: int) -> NDArray[np.int32]:
    """The `Traffic.orders` of the study."""
    return np.tile(np.array([1, 0, 0], np.int32), (n_trains, 1))


STUDY = Traffic()
