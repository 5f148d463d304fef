"""Where trains are going: each one's shortest path to its target, and when it can be where if nobody hinders it.

Place 0 of a path is the configuration in which a train is, NOWHERE off the map; place 1 is the one that it comes to
next, and so on to the target, or for `AHEAD_CELLS`. A train that is committed goes where it is committed to first. The
path of a train without a way to its target ends where it is, or where it departs.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import AHEAD_SHIFT, DONE, NOTHING, NOWHERE, SINGLE, UNREACHED, Batch
from railctl.common.rail.compiled.step import leave

AHEAD_CELLS: Final = 200  # what is farther away changes much before a train comes there


class Ways(NamedTuple):
    """The paths of the trains of one world; in the last of the rows, that of the train in hand behind an exit.

    Attributes:
        paths: [N + 1, AHEAD_CELLS + 1] int32, configurations.
        lengths: [N + 1] int32, of the paths, in places; 0 for a train that has arrived.
        places: [N + 1, C] int16, at which place of its path a train comes to a cell first, or NOTHING.
        paces: [N + 1, 2] float64, the steps that it takes to place 1, and those from one place to the next.
    """

    paths: NDArray[np.int32]
    lengths: NDArray[np.int32]
    places: NDArray[np.int16]
    paces: NDArray[np.float64]


def ways_for(batch: Batch) -> Ways:
    """Room for any world of a batch."""
    rows, cells = batch.trains.shape[1] + 1, batch.cells.shape[1]
    return Ways(
        paths=np.zeros((rows, AHEAD_CELLS + 1), np.int32),
        lengths=np.zeros(rows, np.int32),
        places=np.full((rows, cells), NOTHING, np.int16),
        paces=np.zeros((rows, 2)),
    )


@bare_kernel
def find_ways(batch: Batch, slot: int, ways: Ways) -> None:
    """Find those of all trains of a world as it is now."""
    codes, leads, world = batch.codes[slot], batch.leads[slot], batch.worlds[slot]
    for at in range(world["trains"]):
        train, distances = batch.trains[slot, at], batch.distances[slot, at]
        here = int(train["config"])
        if train["state"] == DONE:
            forget(ways, at)
            continue
        if here == NOWHERE:
            to = int(train["start"])
        elif train["committed"] != NOTHING:
            to = leave(codes, leads, here, int(train["committed"]))
        else:
            to = nearer(codes, leads, distances, here)
        trace(codes, leads, distances, ways, at, here, to)
        set_pace(train, int(world["unit"]), int(world["time"]), ways.paces[at])


@bare_kernel
def set_pace(train: np.void, unit: int, time: int, pace: NDArray[np.float64]) -> None:
    """How long a train needs: for what is left of its cell, or to depart, after its malfunction; then a cell."""
    speed = int(train["full_speed"])
    if train["config"] == NOWHERE:
        first = 1.0 + max(0, int(train["departure"]) - time)
    else:
        first = (unit - int(train["distance"])) / speed
    pace[0] = int(train["malfunction"]) + first
    pace[1] = unit / speed


@bare_kernel
def nearer(codes: NDArray[np.int32], leads: NDArray[np.int32], distances: NDArray[np.int16], here: int) -> int:
    """The next configuration on the shortest path, left before forward before right; NOWHERE if none leads on."""
    code = int(codes[here])
    if code & SINGLE:
        to = code >> AHEAD_SHIFT
        return to if distances[to] < UNREACHED else NOWHERE
    best, ahead = UNREACHED, NOWHERE
    for turn in range(3, 6):
        way = (here + turn) & 3
        if code >> way & 1:
            to = int(leads[(here & ~3) + way])
            if distances[to] < best:
                best, ahead = int(distances[to]), to
    return ahead


@bare_kernel
def forget(ways: Ways, row: int) -> None:
    """Make a path one of no places."""
    for place in range(ways.lengths[row]):
        here = ways.paths[row, place]
        if here != NOWHERE:
            ways.places[row, here >> 2] = NOTHING
    ways.lengths[row] = 0


@bare_kernel
def trace(
    codes: NDArray[np.int32],
    leads: NDArray[np.int32],
    distances: NDArray[np.int16],
    ways: Ways,
    row: int,
    here: int,
    to: int,
) -> None:
    """Write down the path from `here` to `to` and on to the target of `distances`."""
    forget(ways, row)
    path, places = ways.paths[row], ways.places[row]
    path[0] = here
    if here != NOWHERE:
        places[here >> 2] = 0
    length = 1
    while to != NOWHERE and length < len(path):
        path[length] = to
        if places[to >> 2] == NOTHING:
            places[to >> 2] = length
        length += 1
        to = nearer(codes, leads, distances, to) if distances[to] > 0 else NOWHERE
    ways.lengths[row] = length


@bare_kernel
def steps_to(ways: Ways, row: int, place: int) -> float:
    """In how many steps a train can be at a place of its path."""
    return ways.paces[row, 0] + (place - 1) * ways.paces[row, 1] if place > 0 else 0.0
