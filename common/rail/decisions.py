"""The `cells` rule: where the study's trains decide, as a table per level.

Source: "Deep Reinforcement Learning in the Flatland Multi-Agent Environment" (2021): only decisions count,
and on plain track a train moves forward. A train of this rule decides on a cell that has two or more exits for
its heading, or right before one with more than two transition bits (a switch, slip or crossing, however it lies).
"""

import numpy as np
from numpy.typing import NDArray

BITS = np.arange(15, -1, -1, dtype=np.uint16)  # from the highest: [heading, exit]
STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1))  # row and column of a step north, east, south, west


def exits(grid: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """[H, W, 4, 4]: whether a train in a cell with a heading may leave it north, east, south, west."""
    bits: NDArray[np.bool_] = (grid[..., None] >> BITS & 1).astype(np.bool_)
    return bits.reshape(*grid.shape, 4, 4)


def decision_cells(grid: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """[H, W, 4]: whether a train in the cell with a heading decides; false where no train can be."""
    height, width = grid.shape
    ways = exits(grid)
    busy = np.zeros((height + 2, width + 2), dtype=np.bool_)  # with a border of empty cells
    busy[1:-1, 1:-1] = ways.sum(axis=(2, 3)) > 2
    table: NDArray[np.bool_] = ways.sum(axis=3) >= 2
    for towards, (down, right) in enumerate(STEPS):
        ahead = busy[1 + down : 1 + down + height, 1 + right : 1 + right + width]
        table |= ways[..., towards] & ahead[..., None]
    return table
