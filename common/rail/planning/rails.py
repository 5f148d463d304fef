"""Which ways out of a cell a train can take, by which action, and which of them is the shortest to its target.

Arrays are those of a slot of `common.rail.compiled.arrays.Batch`.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import NOTHING, SINGLE, UNREACHED, Batch
from railctl.common.rail.compiled.step import destination
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING


@bare_kernel
def can_leave(codes: NDArray[np.int32], here: int, way: int) -> bool:
    """Whether some action takes a train out of a configuration this way: none turns it round, but in a dead end."""
    is_open = codes[here] >> way & 1 != 0
    return bool(is_open and (codes[here] & SINGLE != 0 or way != (here + 2) & 3))


@bare_kernel
def action_out(codes: NDArray[np.int32], here: int, way: int) -> int:
    """The action that takes a train out of a configuration a way that it can leave."""
    if codes[here] & SINGLE or way == here & 3:
        return MOVE_FORWARD
    return MOVE_LEFT if way == (here + 3) & 3 else MOVE_RIGHT


@bare_kernel
def any_way(codes: NDArray[np.int32], here: int) -> int:
    """The lowest way out; wherever a train can start there is one."""
    way = 0
    while not can_leave(codes, here, way):
        way += 1
    return way


@bare_kernel
def shortest_way(
    codes: NDArray[np.int32], leads: NDArray[np.int32], distance: NDArray[np.int16], here: int, first: int
) -> int:
    """The way out that leads to the target soonest, NOTHING if there is none.

    Args:
        codes: [4C].
        leads: [4C].
        distance: [4C], steps to the train's target.
        here: a configuration.
        first: the way that is taken if several are as short; else the next clockwise.
    """
    best, least = NOTHING, UNREACHED
    for turn in range(4):
        way = (first + turn) & 3
        if can_leave(codes, here, way):
            beyond = distance[leads[(here & ~3) + way]]
            if beyond < least:
                best, least = way, beyond
    return best


@bare_kernel
def shortest_allowed(batch: Batch, slot: int, at: int, bits: int) -> int:
    """The move of those allowed, a bit each, beyond which a train's way is shortest; STOP_MOVING if there is none.

    Of equally short ways the leftmost.
    """
    codes, leads, distance, train = (
        batch.codes[slot],
        batch.leads[slot],
        batch.distances[slot, at],
        batch.trains[slot, at],
    )
    best, least = STOP_MOVING, UNREACHED
    for action in range(MOVE_LEFT, MOVE_RIGHT + 1):
        to = destination(codes, leads, train, action) if bits >> action & 1 else NOTHING
        if to != NOTHING and distance[to] < least:
            best, least = action, int(distance[to])
    return best
