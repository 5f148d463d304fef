"""The planner asked again whenever a train decides: for trains of any speed, and for those that break down.

It acts as a network does, where trains decide, and takes what an interlocking leaves it; where that forbids what is
planned, or a train finds no way, it stops the train.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import kernel
from common.rail.asking import unasked
from common.rail.compiled.arrays import NOTHING
from common.rail.compiled.world import Parts
from common.rail.interlocking.asking import allowed, begin, grant, next_asked
from common.rail.planning.advising import NONE, Desk, advise, desk_for
from common.rail.world import STOP_MOVING
from common.seeding import stream_key
from services.evaluator.references.performing import Act


def replanner(seed: int, orders: int, index: int, parts: Parts) -> Act:
    """What the trains of a freshly loaded world do by the best of so many plans, made anew in every step."""
    world = parts.batch.worlds[0]
    desk = desk_for(parts.batch, int(world["max_steps"]))
    key = np.uint64(stream_key(seed, index, "planner-orders"))
    actions = np.empty(world["trains"], np.int8)

    def act(_step: int) -> NDArray[np.int8]:
        heed(parts, orders, key, desk, actions)
        return actions

    return act


@kernel
def heed(parts: Parts, orders: int, key: np.uint64, desk: Desk, actions: NDArray[np.int8]) -> None:
    """Fill in the actions [N] of the trains of slot 0."""
    batch, mode, signals, deciding = parts.batch, parts.interlocking, parts.signals, parts.deciding[0]
    for train in range(len(actions)):
        actions[train] = unasked(batch.codes[0], batch.trains[0, train]["config"], mode)
    if not deciding.any():
        return
    labels = np.empty(len(actions), np.int8)
    advise(batch, 0, deciding, parts.decisions, orders, key, desk, labels)
    begin(batch, 0, mode, parts.decisions, signals)
    train = next_asked(batch, 0, deciding, signals)
    while train != NOTHING:
        bits = allowed(batch, 0, mode, train, signals)
        is_heeded = labels[train] != NONE and bits >> labels[train] & 1
        actions[train] = labels[train] if is_heeded else STOP_MOVING
        grant(batch, 0, mode, train, actions[train], signals)
        train = next_asked(batch, 0, deciding, signals)
