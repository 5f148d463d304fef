"""Where rails lie, for pictures: every way through a cell is a line from one of its edges to another.

A train with a heading comes in over the opposite edge. A way back to the edge it came in over is a dead end, with a
buffer stop in the middle of the cell. Coordinates are x and y in cells, from the north-western corner.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from railctl.common.rail.decisions import STEPS, exits

# Okabe & Ito's colours, told apart by everybody, then darker relatives for many trains.
COLOURS: Final = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00"),
    *("#56B4E9", "#7A5195", "#8C564B", "#4D4D4D", "#999933"),
)
GROUND, GRID_LINE, BED, STEEL = "#F7F5F0", "#E6E2D8", "#C9C2B4", "#3C3A36"
CURVE_POINTS = 9

Line = NDArray[np.float64]  # [P, 2]


def tracks(grid: NDArray[np.uint16]) -> tuple[list[Line], list[Line]]:
    """All rails of a grid [H, W] of transition maps, and the bars at their ends."""
    rails, stops = [], []
    for row, column, heading, towards in np.argwhere(exits(grid)).tolist():
        if towards == (heading + 2) % 4:
            rails.append(np.array([edge(row, column, towards), (column + 0.5, row + 0.5)]))
            stops.append(buffer_stop(row, column, heading))
        else:
            rails.append(way(row, column, heading, towards))
    return rails, stops


def edge(row: int, column: int, side: int) -> tuple[float, float]:
    """The middle of a cell's edge."""
    return column + 0.5 + 0.5 * STEPS[side][1], row + 0.5 + 0.5 * STEPS[side][0]


def way(row: int, column: int, heading: int, towards: int) -> Line:
    """From the edge that a train comes in over to the one it leaves over, bent around the cell's middle."""
    begin, end = np.array(edge(row, column, (heading + 2) % 4)), np.array(edge(row, column, towards))
    if heading == towards:
        return np.array([begin, end])
    middle = np.array([column + 0.5, row + 0.5])
    t = np.linspace(0, 1, CURVE_POINTS)[:, None]
    curve: Line = (1 - t) ** 2 * begin + 2 * t * (1 - t) * middle + t**2 * end
    return curve


def track(places: Sequence[tuple[int, ...]]) -> Line:
    """[P, 2]: the rails over these cells, from the middle of the first to that of the last, by row, column, heading."""
    if not places:
        return np.zeros((0, 2))
    parts = [np.array([[places[0][1] + 0.5, places[0][0] + 0.5]])]
    for (row, column, heading), (_, _, towards) in pairwise(places):
        leg = way(row, column, heading, towards)
        parts.append(leg[-1:] if len(parts) == 1 else leg)
    parts.append(np.array([[places[-1][1] + 0.5, places[-1][0] + 0.5]]))
    return np.concatenate(parts)


def buffer_stop(row: int, column: int, heading: int) -> Line:
    """[2, 2]: a bar across the end of the rails."""
    across = 0.28 * np.array([STEPS[heading][0], STEPS[heading][1]])
    middle = np.array([column + 0.5, row + 0.5])
    return np.array([middle - across, middle + across])


def arrowhead(middle: NDArray[np.float64], heading: int, size: float) -> Line:
    """[4, 2]: the corners of an arrow's head that points where a train is heading."""
    forwards = np.array([STEPS[heading][1], STEPS[heading][0]])
    sideways = np.array([-forwards[1], forwards[0]])
    corners = ((1, 0), (-0.8, 0.8), (-0.4, 0), (-0.8, -0.8))
    return np.array([middle + size * (forwards * f + sideways * s) for f, s in corners])
