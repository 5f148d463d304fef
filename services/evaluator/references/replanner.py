"""The planner asked again whenever a train decides: for trains of any speed, and for those that break down.

It acts as a network does, where trains decide; a train that finds no way stops.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import kernel
from railctl.common.rail.compiled.world import Parts
from railctl.common.rail.planning.advising import NONE, Desk, advise, desk_for
from railctl.common.rail.world import MOVE_FORWARD, STOP_MOVING
from railctl.common.seeding import stream_key
from railctl.services.evaluator.references.performing import Act


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
    deciding = parts.deciding[0]
    actions[:] = MOVE_FORWARD
    if not deciding.any():
        return
    labels = np.empty(len(actions), np.int8)
    advise(parts.batch, 0, deciding, parts.decisions, orders, key, desk, labels)
    for train in range(len(actions)):
        if deciding[train]:
            actions[train] = labels[train] if labels[train] != NONE else STOP_MOVING
