"""How trains and targets look. Shapes tell their states apart, numbers the trains; no colour is needed.

| state | shape |
|---|---|
| moving | an arrowhead |
| stands | with a bar before its tip |
| waits to depart | a small arrowhead in a circle |
| jammed | on a hatched cell |
| broken down | under a cross |
| late | with a clock beside it |
| target | a square frame with the numbers of its trains |
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.pictures.pen import INK, PAPER, Pen
from railctl.common.rail.decisions import STEPS
from railctl.common.rail.tracks import COLOURS, GROUND, arrowhead

CROSS, HATCHED, MOST_FRAMES = "#C00000", "#F0E442", 2


class Sight(NamedTuple):
    """What is drawn of a train.

    Attributes:
        place: row, column and heading, also while it waits to depart; None: it has arrived.
        is_waiting: it is off the map.
        is_broken: it is broken down.
        stands: it has stopped.
        is_jammed: it will never move again.
        is_late: it is past its latest arrival.
    """

    place: tuple[int, int, int] | None
    is_waiting: bool
    is_broken: bool
    stands: bool = False
    is_jammed: bool = False
    is_late: bool = False


def colour_of(train: int) -> str:
    """A train's colour, which others may have, too."""
    return COLOURS[train % len(COLOURS)]


def label_of(trains: Sequence[int]) -> str:
    """The number of the first train of a place, and how many others there are.

    >>> label_of([7]), label_of([7, 12, 13])
    ('7', '7+2')
    """
    return f"{trains[0]}+{len(trains) - 1}" if len(trains) > 1 else str(trains[0])


def draw_target(pen: Pen, cell: tuple[int, int], trains: Sequence[int], *, numbered: bool = True) -> None:
    """The target of these trains: frames inside each other, and their numbers unless something stands on them."""
    row, column = cell
    for at, train in enumerate(trains[:MOST_FRAMES]):
        inset = 0.02 + 0.1 * at
        corners = np.array([(column + inset, row + inset), (column + 1 - inset, row + 1 - inset)])
        pen.rectangle(corners, None, colour_of(train), 0.08)
    if numbered:
        pen.write((column + 0.5, row + 0.5), label_of(trains), INK, PAPER)


def draw_hatching(pen: Pen, row: int, column: int) -> None:
    """Under a train that is jammed."""
    corner = np.array([column, row])
    pen.rectangle(corner + np.array([[0, 0], [1, 1]]), HATCHED, INK, 0.05)
    for start in (0.33, 0.67, 1.0, 1.33, 1.67):
        low, high = max(0.0, start - 1), min(1.0, start)
        pen.line(corner + np.array([[low, start - low], [high, start - high]]), INK, 0.05)


def draw_train(pen: Pen, number: int, train: Sight) -> None:
    """A train on the map."""
    assert train.place is not None  # noqa: S101  (it is on the map)
    row, column, heading = train.place
    middle = np.array([column + 0.5, row + 0.5])
    pen.polygon(arrowhead(middle, heading, 0.52), colour_of(number), PAPER)
    if train.stands and not train.is_broken:
        draw_bar(pen, middle, heading)
    if train.is_broken:
        draw_cross(pen, middle)
    if train.is_late:
        draw_clock(pen, middle)
    pen.write((column + 0.5, row + 0.5), str(number), PAPER, INK)


def draw_bar(pen: Pen, middle: NDArray[np.float64], heading: int) -> None:
    """Before the tip of a train that stands."""
    forwards = np.array([STEPS[heading][1], STEPS[heading][0]])
    across = np.array([-forwards[1], forwards[0]])
    tip = middle + 0.47 * forwards
    pen.line(np.array([tip - 0.36 * across, tip + 0.36 * across]), INK, 0.14)


def draw_cross(pen: Pen, middle: NDArray[np.float64]) -> None:
    """Over a train that is broken down."""
    for sign in (-1, 1):
        arm = np.array([0.4, 0.4 * sign])
        pen.line(np.array([middle - arm, middle + arm]), CROSS, 0.12)


def draw_clock(pen: Pen, middle: NDArray[np.float64]) -> None:
    """Beside a train that is late."""
    face = middle + np.array([0.36, -0.36])
    pen.ellipse(face + np.array([[-0.2, -0.2], [0.2, 0.2]]), PAPER, INK, 0.06)
    pen.line(face + np.array([[0.0, -0.13], [0.0, 0.0], [0.1, 0.0]]), INK, 0.05)


def draw_waiting(
    pen: Pen, cell: tuple[int, int], trains: Sequence[tuple[int, Sight]], *, numbered: bool = True
) -> None:
    """Trains that wait to depart from a cell: a small arrowhead for each heading, and numbers as of targets."""
    row, column = cell
    middle = np.array([column + 0.5, row + 0.5])
    pen.ellipse(np.array([middle - 0.42, middle + 0.42]), GROUND, colour_of(trains[0][0]), 0.06)
    headings: dict[int, int] = {}
    for number, train in trains:
        assert train.place is not None  # noqa: S101  (it has not arrived)
        headings.setdefault(train.place[2], number)
    for heading, number in headings.items():
        draw_start(pen, middle, heading, number, alone=len(headings) == 1, size=0.3)
    if any(train.is_broken for _, train in trains):
        draw_cross(pen, middle)
    if any(train.is_late for _, train in trains):
        draw_clock(pen, middle)
    if numbered:
        pen.write((column + 0.5, row + 0.5), label_of([number for number, _ in trains]), PAPER, INK)


def draw_start(  # noqa: PLR0913  (where, and how)
    pen: Pen, middle: NDArray[np.float64], heading: int, number: int, *, alone: bool, size: float
) -> None:
    """An arrowhead where trains start; those of several headings stand ahead of the middle."""
    forwards = np.array([STEPS[heading][1], STEPS[heading][0]])
    shrunk, ahead = (size, 0.0) if alone else (0.65 * size, 0.26)
    pen.polygon(arrowhead(middle + ahead * forwards, heading, shrunk), colour_of(number), PAPER)
