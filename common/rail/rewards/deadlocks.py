"""Which trains are in a deadlock: none of them will ever leave its cell.

Definition: the trains in a deadlock are the largest set of trains on the map such that

1. every cell that a train of the set could enter next is held by another train of the set, and
2. no three or more of them could move on in a ring, each into the cell of the next: the rules allow that. (Two that
   swap their cells are no such ring.)

What a train could enter next is what the rails allow, whatever it intends. A train without any such cell is in the set,
too. Trains that are broken down, or within a cell, count like others: they move again. So nothing that trains decide
gets one out of the set, and once in it a train stays there.

The set is what is left of all trains on the map when, again and again, those are taken out that break one of the rules.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE, Batch
from railctl.common.rail.compiled.step import leave
from railctl.common.rail.world import MOVE_LEFT

FREE = -2


@kernel
def find_deadlocks(batch: Batch, slot: int, stuck: NDArray[np.bool_]) -> int:
    """Fill `stuck` [N] with which trains are in a deadlock; returns how many."""
    count = batch.worlds[slot]["trains"]
    ahead = np.empty((count, 3), np.int32)
    left = look_ahead(batch, slot, ahead, stuck)
    return hold(ahead, stuck, left)


@kernel
def hold(ahead: NDArray[np.int32], stuck: NDArray[np.bool_], left: int) -> int:
    """Take all trains out of `stuck` [N], of which there are `left`, that are in no deadlock; returns how many remain.

    `ahead` [N, 3] is what stands left, ahead, right of a train: another train, FREE, or NOTHING if there is no way.
    """
    count = len(ahead)
    left = release(ahead, stuck, left)
    if left < 3:
        return left
    reached, queue = np.empty(count, np.bool_), np.empty(count, np.int32)
    while True:
        freed = 0
        for at in range(count):
            if stuck[at] and turns(ahead, stuck, at, reached, queue):
                stuck[at] = False
                freed += 1
        if freed == 0:
            return left
        left = release(ahead, stuck, left - freed)


@bare_kernel
def look_ahead(batch: Batch, slot: int, ahead: NDArray[np.int32], stuck: NDArray[np.bool_]) -> int:
    """Fill `ahead` [N, 3], and `stuck` [N] with who is on the map; returns how many are."""
    codes, leads, cells, trains = batch.codes[slot], batch.leads[slot], batch.cells[slot], batch.trains[slot]
    left = 0
    for at in range(len(ahead)):
        here = int(trains[at]["config"])
        stuck[at] = here != NOWHERE
        left += here != NOWHERE
        for turn in range(3):
            to = NOTHING if here == NOWHERE else leave(codes, leads, here, MOVE_LEFT + turn)
            other = NOTHING if to == NOTHING else int(cells[to >> 2]["train"])
            ahead[at, turn] = NOTHING if to == NOTHING else FREE if other == NOTHING else other
    return left


@bare_kernel
def release(ahead: NDArray[np.int32], stuck: NDArray[np.bool_], left: int) -> int:
    """Take those out of `stuck` that have somewhere to go, until all that are left have not; returns how many are."""
    changed = True
    while changed:
        changed = False
        for at in range(len(ahead)):
            if not stuck[at]:
                continue
            for turn in range(3):
                other = ahead[at, turn]
                if other == FREE or (other >= 0 and not stuck[other]):
                    stuck[at] = False
                    changed = True
            left -= not stuck[at]
    return left


@bare_kernel
def turns(
    ahead: NDArray[np.int32], stuck: NDArray[np.bool_], at: int, reached: NDArray[np.bool_], queue: NDArray[np.int32]
) -> bool:
    """Whether a stuck train is part of a ring of three or more: whether one ahead gets to it, but not in a single step.

    `reached` and `queue`, [N], are overwritten.
    """
    for turn in range(3):
        first = ahead[at, turn]
        if first < 0 or not stuck[first]:
            continue
        reached[:] = False
        reached[first] = True
        queue[0] = first
        begin, end = 0, 1
        while begin < end:
            here = queue[begin]
            begin += 1
            for way in range(3):
                other = ahead[here, way]
                if other == at and here != first:
                    return True
                if other >= 0 and other != at and stuck[other] and not reached[other]:
                    reached[other] = True
                    queue[end] = other
                    end += 1
    return False
