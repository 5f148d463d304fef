"""The order in which CPython gives the cells of cities out of a set of (row, column).

flatland-rl 4.3.0 keeps them in a set and repairs them in its order, so levels depend on it: restated here is `set` of
CPython 3.11 (`Objects/setobject.c`) for tuples of two numbers (`Objects/tupleobject.c`). No hash of a number depends on
PYTHONHASHSEED.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel

Table = NDArray[np.int64]  # [slots]: cells, as `row * W + column`; -1: none

_PRIME_1, _PRIME_2, _PRIME_5 = -7046029288634856825, -4417276706812531889, 2870177450012600261  # of xxHash, signed
_LINEAR_PROBES = 9
_LEAST_SLOTS = 8


@bare_kernel
def _mixed(sum_so_far: int, number: int) -> int:
    lane = sum_so_far + number * _PRIME_2
    lane = (lane << 31) | ((lane >> 33) & 0x7FFFFFFF)
    return lane * _PRIME_1


@bare_kernel
def hash_of(row: int, column: int) -> int:
    """`hash((row, column))`, of numbers that are not negative."""
    found = _mixed(_mixed(_PRIME_5, row), column) + (2 ^ (_PRIME_5 ^ 3527539))
    return 1546275796 if found == -1 else found


@bare_kernel
def _insert(table: Table, cell: int, width: int) -> bool:
    """Whether the cell was not there yet."""
    found = hash_of(cell // width, cell % width)
    mask = len(table) - 1
    at, perturb = found & mask, found
    while True:
        for probe in range(_LINEAR_PROBES + 1 if at + _LINEAR_PROBES <= mask else 1):
            if table[at + probe] == cell:
                return False
            if table[at + probe] < 0:
                table[at + probe] = cell
                return True
        perturb = (perturb >> 5) & 0x07FFFFFFFFFFFFFF
        at = (at * 5 + 1 + perturb) & mask


@kernel
def _new_table(slots: int) -> Table:
    table = np.empty(slots, np.int64)
    for at in range(slots):
        table[at] = -1
    return table


@kernel
def _resized(table: Table, least: int, width: int) -> Table:
    slots = _LEAST_SLOTS
    while slots <= least:
        slots *= 2
    larger = _new_table(slots)
    for cell in table:
        if cell >= 0:
            _insert(larger, cell, width)
    return larger


@kernel
def _with_cell(table: Table, used: int, cell: int, width: int) -> tuple[Table, int]:
    """`add`."""
    if _insert(table, cell, width):
        used += 1
        if used * 5 >= (len(table) - 1) * 3:
            table = _resized(table, used * 2 if used > 50000 else used * 4, width)
    return table, used


@kernel
def city_cells_as_set(middles: NDArray[np.int64], radius: int, width: int) -> NDArray[np.int64]:
    """The cells of cities: for each city a set of its cells is made, row by row, and put into the set of all.

    Args:
        middles: [C, 2 or more], row and column first.
        radius: of the cities, which are squares.
        width: of the grid.

    Returns:
        [cells], as `row * W + column`.
    """
    everything, used = _new_table(_LEAST_SLOTS), 0
    for city in range(len(middles)):
        own, count = _new_table(_LEAST_SLOTS), 0
        for row in range(middles[city, 0] - radius, middles[city, 0] + radius + 1):
            for column in range(middles[city, 1] - radius, middles[city, 1] + radius + 1):
                own, count = _with_cell(own, count, row * width + column, width)
        if (used + count) * 5 >= (len(everything) - 1) * 3:
            everything = _resized(everything, (used + count) * 2, width)
        if used == 0 and len(everything) == len(own):
            everything, used = own, count
            continue
        empty = used == 0  # then there is no more resizing
        for cell in own:
            if cell < 0:
                continue
            if empty:
                _insert(everything, cell, width)
            else:
                everything, used = _with_cell(everything, used, cell, width)
        if empty:
            used = count
    cells, count = np.empty(used, np.int64), 0
    for cell in everything:
        if cell >= 0:
            cells[count] = cell
            count += 1
    return cells
