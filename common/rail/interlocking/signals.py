"""Room for the interlocking to work in, and its modes."""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.rail.compiled.arrays import Batch
from common.rail.world import N_ACTIONS

Interlocking = Literal["off", "valid", "safe", "planned"]
OFF, VALID, SAFE, PLANNED = range(4)
INTERLOCKINGS: Final = {"off": OFF, "valid": VALID, "safe": SAFE, "planned": PLANNED}
ALL_ACTIONS: Final = (1 << N_ACTIONS) - 1  # a bit each
SEARCHES, MODE, DECISIONS, ROUNDS, ANYWHERE = range(5)  # places in `Signals.numbers`


class Signals(NamedTuple):
    """What is known of one world in one step; see `routes` and `proof` for what the words mean.

    Attributes:
        asked: [N], who need not be asked (any more) in this step.
        routes: [N, 2C + 2] int32, the configurations of each train's route, the first being where it is.
        lengths: [N], of the routes; 0 off the map.
        rests: [N], the place on its route where a train comes to rest, NOTHING for one that arrives or is off the map,
        kept: [N], and as it is while a test has others.
        left: [N], who has not run home yet, in a test,
        home: [N], and who has, one after the other.
        occupants: [C], who is in a cell, or departs into it.
        locks: [C], how many trains have a cell on their routes,
        headings: [C] and with which headings, a bit each.
        resting: [C], who comes to rest in a cell, or NOTHING.
        claims: [C], how many trains claim a cell.
        queue: [4C], of a search,
        stamps: [4C], and which search saw a configuration last.
        places: [4C], where a train may step aside.
        numbers: [5], see above: searches so far; of this step the mode, the rule of decisions, rounds of asking, and whether
            trains may rest in every cell.
    """

    asked: NDArray[np.bool_]
    routes: NDArray[np.int32]
    lengths: NDArray[np.int32]
    rests: NDArray[np.int32]
    kept: NDArray[np.int32]
    left: NDArray[np.bool_]
    home: NDArray[np.int32]
    occupants: NDArray[np.int16]
    locks: NDArray[np.int16]
    headings: NDArray[np.uint8]
    resting: NDArray[np.int16]
    claims: NDArray[np.int16]
    queue: NDArray[np.int32]
    stamps: NDArray[np.int64]
    places: NDArray[np.int32]
    numbers: NDArray[np.int64]


def signals_for(batch: Batch) -> Signals:
    """Room for any world of a batch."""
    trains, cells = batch.trains.shape[1], batch.cells.shape[1]
    return Signals(
        asked=np.zeros(trains, np.bool_),
        routes=np.zeros((trains, 2 * cells + 2), np.int32),
        lengths=np.zeros(trains, np.int32),
        rests=np.zeros(trains, np.int32),
        kept=np.zeros(trains, np.int32),
        left=np.zeros(trains, np.bool_),
        home=np.zeros(trains, np.int32),
        occupants=np.zeros(cells, np.int16),
        locks=np.zeros(cells, np.int16),
        headings=np.zeros(cells, np.uint8),
        resting=np.zeros(cells, np.int16),
        claims=np.zeros(cells, np.int16),
        queue=np.zeros(4 * cells, np.int32),
        stamps=np.zeros(4 * cells, np.int64),
        places=np.zeros(4 * cells, np.int32),
        numbers=np.zeros(5, np.int64),
    )
