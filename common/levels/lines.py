"""Rails between cities as flatland-rl 2.2.2 laid them.

Source: `a_star` and `connect_rail_in_grid_map` of flatland-rl 2.2.2. 4.3.0 keeps the open nodes in a heap and so takes
another of several equally good ones; that leads to other lines, which share more cells with each other.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import kernel

_UNSEEN, _OPEN, _CLOSED = 0, 1, 2
_NO_PARENT = -1


@kernel
def find_line(grid: NDArray[np.uint16], blocked: NDArray[np.bool_], start: int, end: int) -> NDArray[np.int64]:
    """The cells from `start` to `end`; none if there is no way.

    A* with the Manhattan distance, one more for a cell with rails; of the open cells with the least estimate the one
    that was found first is looked at, and no cell is found twice, even if the second way to it were shorter.

    Args:
        grid: [H, W], the rails so far.
        blocked: [H, W], where the line may not pass.
        start: a cell, as `row * W + column`.
        end: a cell.

    Returns:
        [L], the cells in order.
    """
    height, width = grid.shape
    state = np.zeros(height * width, np.uint8)
    parents, steps = np.full(height * width, _NO_PARENT), np.zeros(height * width, np.int64)
    found, estimates = np.empty(height * width, np.int64), np.empty(height * width, np.int64)
    found[0], estimates[0], count = start, 0, 1
    state[start] = _OPEN
    while True:
        best = -1
        for at in range(count):
            if state[found[at]] == _OPEN and (best < 0 or estimates[at] < estimates[best]):
                best = at
        if best < 0:
            return np.empty(0, np.int64)
        cell = found[best]
        state[cell] = _CLOSED
        if cell == end:
            break
        for down, right in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            row, column = cell // width + down, cell % width + right
            if not (0 <= row < height and 0 <= column < width):
                continue
            child = row * width + column
            if state[child] != _UNSEEN or (blocked[row, column] and child not in (start, end)):
                continue
            state[child], parents[child], steps[child] = _OPEN, cell, steps[cell] + 1
            distance = abs(row - end // width) + abs(column - end % width)
            found[count] = child
            estimates[count] = steps[child] + distance + (grid[row, column] != 0)
            count += 1
    line = np.empty(steps[end] + 1, np.int64)
    for at in range(len(line) - 1, -1, -1):
        line[at] = cell
        cell = parents[cell]
    return line


@kernel
def lay_line(grid: NDArray[np.uint16], line: NDArray[np.int64]) -> None:
    """Lay rails along a line of cells; its ends get only what leads on over rails that are there.

    Args:
        grid: [H, W], overwritten.
        line: [L], neighbouring cells, as `row * W + column`.
    """
    width = grid.shape[1]
    last = len(line) - 1
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
