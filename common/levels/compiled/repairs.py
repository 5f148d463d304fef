"""Rails that do not fit to their neighbours, and their repair.

Source: `cell_neighbours_valid` and `SparseRailGen.fix_transitions` of flatland-rl 4.3.0.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.levels.compiled.twister import State, draw_below

NO_SIDE = -1

# All pieces of rail that there are, the frequent ones first: `RailEnvTransitions.transitions_all`.
PIECES = (
    *(
        0x0000,
        0x8020,
        0x0401,
        0x9220,
        0x0C11,
        0x8068,
        0x4403,
        0xC022,
        0x1601,
        0x8830,
        0x0449,
        0x4002,
        0x1200,
        0x0810,
        0x0048,
    ),
    *(
        0x8421,
        0x9621,
        0x8C31,
        0x8469,
        0xC423,
        0xCC33,
        0x9669,
        0x5202,
        0x1A10,
        0x0858,
        0x404A,
        0x2000,
        0x0100,
        0x0080,
        0x0004,
    ),
)
# Switches by the side that nothing leads to, and slips by how they lie.
_LEFT_SWITCHES = (0x4403, 0x9220, 0x0C11, 0x8068)
_RIGHT_SWITCHES = (0x1601, 0x8830, 0x0449, 0xC022)
_DOUBLE_SLIPS = (0xCC33, 0x9669)


@bare_kernel
def ahead(row: int, column: int, side: int) -> tuple[int, int]:
    """The cell on a side of another."""
    if side == 0:
        return row - 1, column
    if side == 1:
        return row, column + 1
    if side == 2:
        return row + 1, column
    return row, column - 1


@bare_kernel
def _leads(piece: int, side: int) -> bool:
    """Whether a train of some heading leaves a piece of rail on a side."""
    return bool(piece & (0x8888 >> side))


@bare_kernel
def is_broken(grid: NDArray[np.uint16], row: int, column: int) -> bool:
    """Whether a cell needs repair.

    It is no piece of rail, or leads off the grid or to where a train cannot go on, or is empty although a neighbour
    leads to it.
    """
    height, width = grid.shape
    piece = int(grid[row, column])
    if piece not in PIECES:
        return True
    for side in range(4):
        there, across = ahead(row, column, side)
        inside = 0 <= there < height and 0 <= across < width
        if _leads(piece, side) and not (inside and int(grid[there, across]) >> (12 - 4 * side) & 15):
            return True
        if piece == 0 and inside and _leads(int(grid[there, across]), (side + 2) % 4):
            return True
    return False


@bare_kernel
def _way(heading: int, side: int) -> int:
    return 1 << (15 - 4 * heading - side)


@bare_kernel
def repair(grid: NDArray[np.uint16], row: int, column: int, towards: int, state: State) -> None:
    """Replace a cell by the piece of rail that its neighbours ask for.

    Args:
        grid: [H, W], overwritten.
        row: of the cell.
        column: of the cell.
        towards: the side that switches should face, NO_SIDE: any.
        state: of the generator, for switches and slips that may lie either way.
    """
    height, width = grid.shape
    count, first, last, hole = 0, -1, -1, -1
    for side in range(4):
        there, across = ahead(row, column, side)
        inside = 0 <= there < height and 0 <= across < width
        if inside and _leads(int(grid[there, across]), (side + 2) % 4):
            count += 1
            first, last = side if first < 0 else first, side
        elif hole < 0:
            hole = side
    if count == 1 and grid[row, column] != 0:
        grid[row, column] = _way((first + 2) % 4, first)
    elif count == 2:
        grid[row, column] = _way((first + 2) % 4, last) | _way((last + 2) % 4, first)
    elif count == 3:
        turn = (towards - hole + 3) % 4
        left = turn == 0
        if towards == NO_SIDE or turn in (1, 3):
            left = draw_below(state, 2) == 1
        grid[row, column] = _LEFT_SWITCHES[hole] if left else _RIGHT_SWITCHES[hole]
    elif count == 4:
        grid[row, column] = _DOUBLE_SLIPS[draw_below(state, 2)]
