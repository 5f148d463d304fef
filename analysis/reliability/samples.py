"""Resampled runs of a metric, zone by zone: the same questions to metrics of single runs and to those over all runs."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from railctl.analysis.reliability.curves import Curves, Floats
from railctl.analysis.reliability.draws import Draws
from railctl.analysis.reliability.measures import curve_ranges, dispersion_of_runs, points_across_runs
from railctl.analysis.reliability.resampling import (
    bootstrapped_curves,
    bootstrapped_rank,
    bootstrapped_runs,
    pairs_of,
    permuted_curves,
    permuted_difference,
    permuted_runs,
)
from railctl.analysis.reliability.switches import Switches
from railctl.analysis.reliability.zones import Zones, penalties_by_zone


class Samples(Protocol):
    """Of penalties [A, K] or [A, K, R], which are those of a zone on some levels."""

    def bootstrapped(self, worse: Floats, zone: str, levels: Sequence[int]) -> Floats:
        """Mean ranks [A, n], each when the runs of this algorithm alone are drawn anew."""

    def permuted(self, worse: Floats, zone: str, levels: Sequence[int]) -> Floats:
        """Differences of mean rank [pairs, n], when the runs of the pair are dealt out anew."""


class RunSamples:
    """Of a metric that every run has a value of."""

    def __init__(self, draws: Draws) -> None:
        self._draws = draws

    def bootstrapped(self, worse: Floats, _zone: str, _levels: Sequence[int]) -> Floats:
        return bootstrapped_runs(worse, self._draws)

    def permuted(self, worse: Floats, _zone: str, _levels: Sequence[int]) -> Floats:
        return permuted_runs(worse, self._draws)


class CurveSamples:
    """Of the dispersion across runs, which every sample of curves has a value of."""

    def __init__(self, curves: Curves, zones: Zones, switches: Switches, draws: Draws) -> None:
        points, ranges = points_across_runs(curves, switches), curve_ranges(curves, switches)

        def by_zone(values: Floats) -> dict[str, Floats]:
            return penalties_by_zone(values, "DR", zones, switches)

        self._bootstrapped = by_zone(bootstrapped_curves(points, ranges, dispersion_of_runs, draws.choices(1)[:, 0]))
        if switches.dr_center:
            points = points - points.mean(2, keepdims=True)
        shuffles = draws.shuffles(1)[:, 0]
        self._permutations = len(shuffles)
        self._permuted = []
        for pair in pairs_of(len(points)):
            theirs = None if ranges is None else ranges[list(pair)]
            self._permuted.append(by_zone(permuted_curves(points[list(pair)], theirs, dispersion_of_runs, shuffles)))

    def bootstrapped(self, worse: Floats, zone: str, levels: Sequence[int]) -> Floats:
        return bootstrapped_rank(worse, self._bootstrapped[zone][:, :, levels])

    def permuted(self, worse: Floats, zone: str, levels: Sequence[int]) -> Floats:
        differences = np.empty((len(self._permuted), self._permutations))
        for row, (pair, samples) in enumerate(zip(pairs_of(len(worse)), self._permuted, strict=True)):
            differences[row] = permuted_difference(worse, pair, samples[zone][:, :, levels])
        return differences
