"""Which ways out of a cell a train can take, by which action, and which of them is the shortest to its target."""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.rail.compiled.arrays import NOTHING, SINGLE, UNREACHED, WAYS, Batch
from common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT


@bare_kernel
def can_leave(codes: NDArray[np.int32], here: int, way: int) -> bool:
    """Whether some action takes a train out of a configuration this way: none turns it round, but in a dead end."""
    return codes[here] >> way & 1 != 0 and (codes[here] & SINGLE != 0 or way != (here + 2) & 3)


@bare_kernel
def action_out(codes: NDArray[np.int32], here: int, way: int) -> int:
    """The action that takes a train out of a configuration a way that it can leave."""
    if codes[here] & SINGLE or way == here & 3:
        return MOVE_FORWARD
    return MOVE_LEFT if way == (here + 3) & 3 else MOVE_RIGHT


@bare_kernel
def any_way(codes: NDArray[np.int32], here: int) -> int:
    """The lowest way out; every configuration that a train starts from has one."""
    way = 0
    while not codes[here] >> way & WAYS & 1:
        way += 1
    return way


@bare_kernel
def shortest_way(
    codes: NDArray[np.int32], leads: NDArray[np.int32], distance: NDArray[np.int16], here: int, first: int
) -> int:
    """The way out that leads to the target soonest, NOTHING if there is none.

    Args:
        codes: [4C], see `common.rail.compiled.arrays`, as all of these.
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


@kernel
def routes(batch: Batch) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The shortest paths of all trains of slot 0, from where they start to their targets.

    Returns:
        [N, L]: configurations, unused places NOTHING; [N]: how many, 0 if there is no path.
    """
    trains = batch.trains[0][: batch.worlds[0]["trains"]]
    codes, leads, distances = batch.codes[0], batch.leads[0], batch.distances[0]
    lengths = np.zeros(len(trains), np.int32)
    for at in range(len(trains)):
        distance = distances[at, trains[at]["start"]]
        lengths[at] = 0 if distance == UNREACHED else distance + 1
    found = np.full((len(trains), max(1, lengths.max())), NOTHING, np.int32)
    for at in range(len(trains)):
        here = int(trains[at]["start"])
        for place in range(lengths[at]):
            found[at, place] = here
            if place + 1 < lengths[at]:
                here = int(leads[(here & ~3) + shortest_way(codes, leads, distances[at], here, 0)])
    return found, lengths
