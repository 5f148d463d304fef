"""Lines between cities: the way that one takes, and its rails.

Source: `a_star` and `connect_rail_in_grid_map` of flatland-rl 2.2.2 and 4.3.0. They differ in which of several equally
good cells is looked at next, and so take other ways.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.levels.compiled.repairs import NO_SIDE

_UNSEEN, _OPEN, _CLOSED = 0, 1, 2
_NO_PARENT = -1
_ORDER_BITS = 32
_DOWN, _RIGHT = (0, 0, -1, 1), (-1, 1, 0, 0)  # in the library's order


Search = NDArray[np.int64]  # [SEARCH_ROWS, H * W], what a search writes on, by cell but for the last three

STATUS, PARENT, STEPS, PRIORITY, WAITING, LINE = range(
    6
)  # PRIORITY, WAITING: a heap of open cells; LINE: what was found
SEARCH_ROWS = 6


@bare_kernel
def _rise(search: Search, at: int) -> None:
    """`heapq._siftdown` to the top."""
    priority, cell = search[PRIORITY, at], search[WAITING, at]
    while at > 0:
        above = (at - 1) >> 1
        if priority >= search[PRIORITY, above]:
            break
        search[PRIORITY, at], search[WAITING, at] = search[PRIORITY, above], search[WAITING, above]
        at = above
    search[PRIORITY, at], search[WAITING, at] = priority, cell


@bare_kernel
def _remove_first(search: Search, count: int) -> None:
    """`heapq.heappop` of so many and one: which of equal ones comes first is as it leaves it."""
    priority, cell = search[PRIORITY, count], search[WAITING, count]
    at, below = 0, 1
    while below < count:
        if below + 1 < count and search[PRIORITY, below] >= search[PRIORITY, below + 1]:
            below += 1
        search[PRIORITY, at], search[WAITING, at] = search[PRIORITY, below], search[WAITING, below]
        at, below = below, 2 * below + 1
    search[PRIORITY, at], search[WAITING, at] = priority, cell
    _rise(search, at)


@bare_kernel
def find_line(
    grid: NDArray[np.uint16], sides: NDArray[np.int64], ends: tuple[int, int], first_found: bool, search: Search
) -> int:
    """Find a way from one cell to another, and say how many cells it has; 0 if there is none.

    A* with the Manhattan distance, one more for a cell with rails. No cell is found twice, even if the second way to it
    were shorter.

    Args:
        grid: [H, W], the rails so far.
        sides: [H, W], NO_SIDE where the line may pass; it may begin and end elsewhere.
        ends: two cells, as `row * W + column`.
        first_found: whether of equally good cells the one that was found first comes first, as in 2.2.2; else
            whatever a heap makes of it, as in 4.3.0.
        search: [SEARCH_ROWS, H * W], overwritten; row LINE gets the cells in order.
    """
    height, width = grid.shape
    start, end = ends
    for place in range(height * width):
        search[STATUS, place] = _UNSEEN
    search[STATUS, start], search[PARENT, start], search[STEPS, start] = _OPEN, _NO_PARENT, 0
    search[PRIORITY, 0], search[WAITING, 0] = 0, start
    count = found = 1
    cell = _NO_PARENT
    while count > 0 and cell != end:
        cell = search[WAITING, 0]
        count -= 1
        _remove_first(search, count)
        search[STATUS, cell] = _CLOSED
        for side in range(4):
            row, column = cell // width + _DOWN[side], cell % width + _RIGHT[side]
            if not (0 <= row < height and 0 <= column < width):
                continue
            child = row * width + column
            if search[STATUS, child] != _UNSEEN or (sides[row, column] != NO_SIDE and child not in (start, end)):
                continue
            steps = search[STEPS, cell] + 1
            search[STATUS, child], search[PARENT, child], search[STEPS, child] = _OPEN, cell, steps
            estimate = steps + abs(row - end // width) + abs(column - end % width) + (grid[row, column] != 0)
            search[PRIORITY, count] = estimate << _ORDER_BITS | (found if first_found else 0)
            search[WAITING, count] = child
            _rise(search, count)
            found += 1
            count += 1
    if cell != end:
        return 0
    length = search[STEPS, end] + 1
    for at in range(length - 1, -1, -1):
        search[LINE, at] = cell
        cell = search[PARENT, cell]
    return int(length)


@bare_kernel
def lay_line(grid: NDArray[np.uint16], line: NDArray[np.int64], length: int) -> None:
    """Lay rails along a line of cells; its ends get only what leads on over rails that are there.

    Args:
        grid: [H, W], overwritten.
        line: neighbouring cells, as `row * W + column`.
        length: how many of them count, not 0.
    """
    width = grid.shape[1]
    last = length - 1
    heading = -1
    for at in range(last):
        step = line[at + 1] - line[at]
        towards = 0 if step == -width else 1 if step == 1 else 2 if step == width else 3
        row, column = line[at] // width, line[at] % width
        if at > 0:
            back = 4 * ((towards + 2) % 4) + (heading + 2) % 4
            grid[row, column] |= np.uint16(1 << (15 - 4 * heading - towards)) | np.uint16(1 << (15 - back))
        elif grid[row, column] != 0:
            grid[row, column] |= np.uint16(1 << (15 - 5 * towards))
        heading = towards
    row, column = line[last] // width, line[last] % width
    if last > 0 and grid[row, column] != 0:
        grid[row, column] |= np.uint16(1 << (15 - 5 * heading))
