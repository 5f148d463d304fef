"""How far it is to a cell from everywhere, over the rails of a grid: one breadth-first search backwards a cell."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel

NO_WAY = -1


@bare_kernel
def measure(
    grid: NDArray[np.uint16], row: int, column: int, distances: NDArray[np.int32], queue: NDArray[np.int32]
) -> None:
    """Measure how many steps it is to a cell.

    Args:
        grid: [H, W].
        row: of the cell.
        column: of the cell.
        distances: [H * W * 4], overwritten: from each cell and heading, whatever the heading there; NO_WAY: none.
        queue: [H * W * 4], overwritten.
    """
    height, width = grid.shape
    for place in range(len(distances)):
        distances[place] = NO_WAY
    begin = end = 0
    for heading in range(4):
        queue[end] = 4 * (row * width + column) + heading
        distances[queue[end]] = 0
        end += 1
    while begin < end:
        at, towards = queue[begin] >> 2, queue[begin] & 3
        steps = distances[queue[begin]] + 1
        begin += 1
        from_row = at // width + (1 if towards == 0 else -1 if towards == 2 else 0)
        from_column = at % width + (1 if towards == 3 else -1 if towards == 1 else 0)
        if not (0 <= from_row < height and 0 <= from_column < width):
            continue
        piece = int(grid[from_row, from_column])
        for heading in range(4):
            place = 4 * (from_row * width + from_column) + heading
            if piece >> (15 - 4 * heading - towards) & 1 and distances[place] == NO_WAY:
                distances[place] = steps
                queue[end] = place
                end += 1
