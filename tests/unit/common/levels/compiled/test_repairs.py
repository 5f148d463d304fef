"""Which cells are broken, and what replaces them, is as the library has it."""

import numpy as np
import pytest
from flatland.envs.grid.rail_env_grid import RailEnvTransitions
from flatland.envs.rail_generators import SparseRailGen
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from numpy.random import RandomState

from railctl.common.levels.compiled.repairs import PIECES, is_broken, repair
from railctl.common.levels.compiled.twister import plainly_seeded
from railctl.tools.levels.library import forget_rails

SIDE = 8


def damaged(seed: int) -> np.ndarray:
    """Mostly pieces of rail that do not fit to each other, some that are none."""
    rng = np.random.default_rng(seed)
    grid = rng.choice(np.array([*PIECES, 0, 0, 0, 0, 0, 0]), (SIDE, SIDE))
    return np.where(rng.random((SIDE, SIDE)) < 0.1, rng.integers(0, 1 << 16, (SIDE, SIDE)), grid).astype(np.uint16)


def test_the_pieces_are_the_library_s():
    assert sorted(PIECES) == sorted(RailEnvTransitions().transitions_all)


@pytest.mark.parametrize("seed", range(6))
def test_cells_are_broken_and_repaired_as_in_the_library(seed: int):
    grid = damaged(seed)
    rails = RailGridTransitionMap(SIDE, SIDE, grid=grid.copy())
    places = list(np.ndindex(SIDE, SIDE))
    broken = [is_broken(grid, *place) for place in places]
    assert broken == [not rails.cell_neighbours_valid(place, True) for place in places]
    assert {True, False} == set(broken)
    state, rng, sides = plainly_seeded(seed), RandomState(seed), np.random.default_rng(seed)
    for row, column in places:
        towards = int(sides.integers(-1, 4))
        repair(grid, row, column, towards, state)
        SparseRailGen.fix_transitions(rails, (row, column), towards, rng)
        np.testing.assert_array_equal(grid, rails.grid)
    forget_rails()
