"""The order of a set of cells is CPython's."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from railctl.common.levels.compiled.set_order import city_cells_as_set, hash_of

WIDTH = 200
PLACES = st.tuples(st.integers(min_value=13, max_value=186), st.integers(min_value=13, max_value=186))


@settings(deadline=None)  # the first call compiles
@given(st.integers(min_value=0, max_value=10_000), st.integers(min_value=0, max_value=10_000))
def test_hashes_of_pairs(row: int, column: int):
    assert hash_of(row, column) == hash((row, column))


def cells(row: int, column: int, radius: int) -> set[tuple[int, int]]:
    rows, columns = range(row - radius, row + radius + 1), range(column - radius, column + radius + 1)
    return {(at, across) for at in rows for across in columns}


@settings(deadline=None)  # the first call compiles
@given(st.lists(PLACES, min_size=1, max_size=12), st.integers(min_value=1, max_value=12))
@example([(20, 20), (21, 22)], 3)  # which share cells
@example([(15, 15)] * 2, 1)
def test_cells_of_cities(middles: list[tuple[int, int]], radius: int):
    everything: set[tuple[int, int]] = set()
    for middle in middles:
        everything.update(cells(*middle, radius))
    found = city_cells_as_set(np.array(middles), radius, WIDTH)
    assert [(cell // WIDTH, cell % WIDTH) for cell in found.tolist()] == list(everything)
