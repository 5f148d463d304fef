"""How far it is to a cell from everywhere, over the rails of a grid: one breadth-first search backwards a cell."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.kernel import kernel

NO_WAY = -1


class Distances:
    """The distances on one grid, each target's computed when it is first asked for."""

    def __init__(self, grid: NDArray[np.uint16]) -> None:
        self._grid = np.ascontiguousarray(grid, np.uint16)
        self._found: dict[tuple[int, int], NDArray[np.int32]] = {}

    def between(self, start: tuple[Any, Any], heading: Any, target: tuple[Any, Any]) -> int:
        """Steps from a cell and heading to a cell, whatever the heading there; NO_WAY if there is none."""
        row, column = int(target[0]), int(target[1])
        if (row, column) not in self._found:
            self._found[row, column] = measure(self._grid, row, column)
        return int(self._found[row, column][int(start[0]), int(start[1]), int(heading)])

    def reaches(self, start: tuple[Any, Any], heading: Any, target: tuple[Any, Any]) -> bool:
        """The library's `check_path_exists`."""
        return self.between(start, heading, target) != NO_WAY


@kernel
def measure(grid: NDArray[np.uint16], row: int, column: int) -> NDArray[np.int32]:
    """[H, W, 4]: steps to a cell from each cell and heading; -1: there is no way."""
    height, width = grid.shape
    distances = np.full((height, width, 4), -1, np.int32)
    queue = np.empty((height * width * 4, 3), np.int32)
    begin = end = 0
    for heading in range(4):
        distances[row, column, heading] = 0
        queue[end, 0], queue[end, 1], queue[end, 2] = row, column, heading
        end += 1
    while begin < end:
        at_row, at_column, towards = queue[begin, 0], queue[begin, 1], queue[begin, 2]
        steps = distances[at_row, at_column, towards] + 1
        begin += 1
        from_row = at_row + (1 if towards == 0 else -1 if towards == 2 else 0)
        from_column = at_column + (1 if towards == 3 else -1 if towards == 1 else 0)
        if not (0 <= from_row < height and 0 <= from_column < width):
            continue
        piece = int(grid[from_row, from_column])
        for heading in range(4):
            if piece >> (15 - 4 * heading - towards) & 1 and distances[from_row, from_column, heading] < 0:
                distances[from_row, from_column, heading] = steps
                queue[end, 0], queue[end, 1], queue[end, 2] = from_row, from_column, heading
                end += 1
    return distances
