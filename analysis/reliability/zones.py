"""Zones of training (its beginning, middle and end), and what a metric comes to in each."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from railctl.analysis.reliability.curves import Curves, Floats
from railctl.analysis.reliability.measures import METRICS
from railctl.analysis.reliability.ranks import penalties
from railctl.analysis.reliability.switches import Switches

Zones = dict[str, list[int] | None]  # the points of each, by index


@dataclass(frozen=True)
class Measured:
    """A metric under one setting of the switches."""

    values: Floats  # [A, K, R or not, P or not]
    zones: Zones
    worse: dict[str, Floats]  # by zone [A, K, R or not]; less is better


def measured(curves: Curves, metric: str, switches: Switches) -> Measured:
    """Values, and what they come to by zone; of runs without range they are not finite."""
    values = METRICS[metric].of(curves, switches)
    zones = zones_of(curves, metric, switches)
    return Measured(values, zones, penalties_by_zone(values, metric, zones, switches))


def zones_of(curves: Curves, metric: str, switches: Switches) -> Zones:
    """zone0, zone1, ..., or the whole training."""
    points = evaluation_points(curves, metric, switches)
    if points is None:
        return {"whole": None}
    return {f"zone{zone}": chosen for zone, chosen in enumerate(zone_points(points, curves.zones))}


def evaluation_points(curves: Curves, metric: str, switches: Switches) -> list[int] | None:
    """The times [P] that the original would be told of, if the metric has any: in blocks, or in episodes."""
    if "P" not in METRICS[metric].axes:
        return None
    step = curves.block if metric in {"DT", "MEDPERF"} or switches.lowpass else 1
    first = step if switches.zones == "tool" else 0
    return list(range(first, first + step * curves.points, step))


def zone_points(points: list[int], zones: int) -> list[list[int]]:
    """Which points lie in each zone, by index.

    The original divides the distance from the first point to the last into equal lengths, but counts these from 0. So
    it cuts evenly only if the first point is 0: 15 points are 5, 5 and 5 then, and 4, 5 and 6 if they start at 1.
    """
    length = (points[-1] - points[0]) / zones
    cuts = [0, *(sum(point < zone * length for point in points) for zone in range(1, zones)), len(points)]
    return [list(range(start, end)) for start, end in pairwise(cuts)]


def penalties_by_zone(values: Floats, metric: str, zones: Zones, switches: Switches) -> dict[str, Floats]:
    """The median (or mean) of each zone's points, the last axis, as penalties; of no points it is nan."""
    collapse = np.median if switches.zone_collapse == "median" else np.mean
    worse = {}
    for zone, points in zones.items():
        if points is None:
            value = values
        elif points:
            value = np.asarray(collapse(values[..., points], axis=-1))
        else:
            value = np.full(values.shape[:-1], np.nan)
        worse[zone] = penalties(value, bigger_is_better=METRICS[metric].bigger_is_better)
    return worse
