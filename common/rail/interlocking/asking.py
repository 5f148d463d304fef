"""Asking for actions: within a step trains are asked one after another, and what is granted binds those after.

    begin(...)                                    # once a step
    while (train := next_asked(...)) != NOTHING:
        bits = allowed(..., train)                # a bit for each action that it may take
        grant(..., train, action)                 # what it does

Whoever stands before its own cell's next train is asked after that one, so that it knows whether the place is left.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel
from common.rail.compiled.arrays import NOTHING, NOWHERE, SINGLE, Batch
from common.rail.interlocking.signals import ALL_ACTIONS, OFF, Signals
from common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING

FORWARD: int = 1 << MOVE_FORWARD
STOP: int = 1 << STOP_MOVING


@bare_kernel
def begin(batch: Batch, slot: int, mode: int, signals: Signals) -> None:
    """Before the trains of a slot are asked in a step."""
    for at in range(batch.worlds[slot]["trains"]):
        signals.asked[at] = False


@bare_kernel
def next_asked(batch: Batch, slot: int, deciding: NDArray[np.bool_], signals: Signals) -> int:
    """The next train to ask, of those that decide [N]; NOTHING if all have been asked."""
    for at in range(batch.worlds[slot]["trains"]):
        if deciding[at] and not signals.asked[at]:
            signals.asked[at] = True
            return at
    return NOTHING


@bare_kernel
def valid(codes: NDArray[np.int32], here: int) -> int:
    """The actions that are there: a train may stop or go on; turn only where rails do; no two do the same."""
    if here == NOWHERE or codes[here] & SINGLE:
        return FORWARD | STOP
    bits, heading = STOP, here & 3
    if codes[here] >> heading & 1:
        bits |= FORWARD
    if codes[here] >> ((heading + 3) & 3) & 1:
        bits |= 1 << MOVE_LEFT
    if codes[here] >> ((heading + 1) & 3) & 1:
        bits |= 1 << MOVE_RIGHT
    return bits


@bare_kernel
def allowed(batch: Batch, slot: int, mode: int, train: int, signals: Signals) -> int:
    """The actions that a train may take, a bit each; any train that is not done may be asked, deciding or not."""
    if mode == OFF:
        return ALL_ACTIONS
    return valid(batch.codes[slot], batch.trains[slot, train]["config"])


@bare_kernel
def grant(batch: Batch, slot: int, mode: int, train: int, action: int, signals: Signals) -> None:
    """A train takes an action: whoever is asked later in this step is told as much."""
