"""Room for the interlocking to work in, and its modes."""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.rail.compiled.arrays import Batch
from railctl.common.rail.world import N_ACTIONS

Interlocking = Literal["off", "valid", "safe", "planned"]
OFF, VALID, SAFE, PLANNED = range(4)
INTERLOCKINGS: Final = {"off": OFF, "valid": VALID, "safe": SAFE, "planned": PLANNED}
ALL_ACTIONS: Final = (1 << N_ACTIONS) - 1  # a bit each
SEARCHES, MODE, DECISIONS, ROUNDS, PATIENCE = range(5)  # places in `Signals.numbers`


AT = np.dtype(
    [
        ("length", np.int32),  # of its route; 0 off the map
        ("rest", np.int32),  # the place on its route where it comes to rest, or NOTHING: it arrives, or is off the map
        ("kept", np.int32),  # that place, while a test has others
        ("home", np.int32),  # in a test: who was the first, second, ... to get home
        ("left", np.bool_),  # in a test: it has not got home yet
        ("asked", np.bool_),  # in this step
    ],
    align=True,
)
CELL = np.dtype(
    [
        ("occupant", np.int16),  # who is in it, or departs into it, or NOTHING
        ("resting", np.int16),  # who comes to rest in it, or NOTHING
        ("locks", np.int16),  # how many trains have it on their routes,
        ("headings", np.int16),  # and with which headings, a bit each
        ("claims", np.int16),  # how many trains claim it
    ],
    align=True,
)
QUEUE, STAMPS, PLACES = range(3)  # rows of `Signals.search`


class Signals(NamedTuple):
    """What is known of one world in one step; see `routes` and `proof` for what the words mean.

    Attributes:
        trains: [N] of AT.
        cells: [C] of CELL.
        routes: [N, 2C + 2], the configurations of each train's route, the first being where it is.
        search: [3, 4C]: configurations to go on from, which search saw one last, where a train may step aside.
        numbers: [5], see above: searches so far; of this step the mode, the rule of decisions, and rounds of asking;
            after how many steps of standing trains have to go on, 0 for never.
    """

    trains: NDArray[np.void]
    cells: NDArray[np.void]
    routes: NDArray[np.int32]
    search: NDArray[np.int32]
    numbers: NDArray[np.int32]


def signals_for(batch: Batch, patience: int | None = None) -> Signals:
    """Room for any world of a batch, whose trains may stand so many steps where they could go on."""
    numbers = np.zeros(5, np.int32)
    numbers[PATIENCE] = patience or 0
    trains, cells = batch.trains.shape[1], batch.cells.shape[1]
    return Signals(
        trains=np.zeros(trains, AT),
        cells=np.zeros(cells, CELL),
        routes=np.zeros((trains, 2 * cells + 2), np.int32),
        search=np.zeros((3, 4 * cells), np.int32),
        numbers=numbers,
    )
