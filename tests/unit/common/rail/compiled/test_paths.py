"""The tables of a level against their definitions, on rails that nobody would lay."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.arrays import (
    AHEAD_SHIFT,
    DEAD_END,
    DECIDES,
    PLAIN,
    SINGLE,
    UNREACHED,
    UNUSABLE,
    WAYS,
)
from railctl.common.rail.compiled.paths import code_of, count_bits, ways_out
from railctl.common.rail.compiled.world import CompiledWorld

STEPS = [(-1, 0), (0, 1), (1, 0), (0, -1)]
WORLD = CompiledWorld(1, 1, rules="stock")


def test_codes_by_definition():
    leads = np.array([40, 41, 42, 43], np.int32)
    for ways in range(16):
        exits = ways.bit_count()
        for bits in range(17):
            code = code_of(ways, bits, leads)
            assert code == code_of.py_func(ways, bits, leads)
            assert code & WAYS == ways
            assert code >> AHEAD_SHIFT == (leads[ways.bit_length() - 1] if exits == 1 else 0)
            assert bool(code & SINGLE) == (exits == 1)
            assert bool(code & DEAD_END) == (exits == 1 and bits == 1)
            assert bool(code & UNUSABLE) == (exits < 2 < bits)
            assert bool(code & PLAIN) == (exits == 1 and bits == 2)


def test_bits_are_counted():
    assert all(count_bits(number) == number.bit_count() for number in range(1 << 16))


def inside(grid, row, column):
    return 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]


def moves_of(grid):
    """All moves that rails allow: from (row, column, heading) to the same of the next cell."""
    moves = {}
    for row, column in np.ndindex(grid.shape):
        for heading in range(4):
            ways = ways_out.py_func(int(grid[row, column]), heading)
            ends = [(row + STEPS[way][0], column + STEPS[way][1], way) for way in range(4) if ways >> way & 1]
            moves[row, column, heading] = [to for to in ends if inside(grid, *to[:2])]
    return moves


def rails_of(moves, shape):
    """The grid of these moves."""
    grid = np.zeros(shape, np.uint16)
    for (row, column, heading), ends in moves.items():
        for _, _, way in ends:
            grid[row, column] |= np.uint16(1 << (12 - 4 * heading + 3 - way))
    return grid


def farness(moves, target):
    """Steps from everywhere to a cell, by trying until nothing changes."""
    far = {at: 0 for at, ends in moves.items() if at[:2] == target and ends}
    while True:
        nearer = {at: 1 + min(far[to] for to in ends if to in far) for at, ends in moves.items() if far.keys() & ends}
        nearer = {at: steps for at, steps in nearer.items() if steps < far.get(at, UNREACHED)}
        if not nearer:
            return far
        far |= nearer


@settings(deadline=None)
@given(st.integers(2, 5), st.integers(2, 5), st.sampled_from([1, 2, 3]), st.integers(0, 2**32))
def test_distances_and_decisions_are_those_of_a_plain_search(height, width, sparseness, seed):
    rng = np.random.default_rng(seed)
    grid = np.bitwise_and.reduce(rng.integers(0, 1 << 16, (sparseness, height, width)).astype(np.uint16))
    moves = moves_of(grid)
    grid = rails_of(moves, grid.shape)  # without those that lead off it
    target = tuple(int(rng.integers(side)) for side in grid.shape)
    if not any(moves[*target, heading] for heading in range(4)):
        return
    WORLD.load(0, Level(grid, np.array([[*target, 0]], np.int32), np.array([target], np.int32), 9))
    batch, expected = WORLD.batch, farness(moves, target)
    cells = batch.cells[0, : batch.worlds[0]["cells"]]
    mattering = {to[:2] for ends in moves.values() for to in ends} | {target}
    mattering |= {at[:2] for at, ends in moves.items() if ends}
    assert list(zip(cells["row"].tolist(), cells["column"].tolist(), strict=True)) == sorted(mattering)
    for number, cell in enumerate(sorted(mattering)):
        for heading in range(4):
            config, ends = number * 4 + heading, moves[*cell, heading]
            assert batch.distances[0, 0, config] == expected.get((*cell, heading), UNREACHED)
            forks = [to for to in ends if int(grid[to[:2]]).bit_count() > 2]
            assert bool(batch.codes[0, config] & DECIDES) == (len(ends) > 1 or bool(forks))
