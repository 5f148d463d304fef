"""Distances are there where the library finds a way."""

import numpy as np
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap

from railctl.common.levels.compiled.distances import NO_WAY, measure
from railctl.common.levels.shipped import generate
from railctl.tools.levels.library import forget_rails


def test_ways_are_those_that_the_library_finds():
    level = generate("hard", 2)
    height, width = level.grid.shape
    rail = RailGridTransitionMap(width, height, grid=level.grid.copy())
    target = tuple(level.targets[0].tolist())
    distances, queue = np.zeros((height * width * 4), np.int32), np.zeros(height * width * 4, np.int32)
    measure(level.grid, *target, distances, queue)
    found = [
        (
            distances[4 * (row * width + column) + heading] != NO_WAY,
            rail.check_path_exists((row, column), heading, target),
        )
        for row, column in np.argwhere(level.grid).tolist()
        for heading in range(4)
    ]
    assert [ours for ours, _ in found] == [theirs for _, theirs in found]
    assert {True, False} == {ours for ours, _ in found}
    forget_rails()
