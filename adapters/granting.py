"""Actions of agents that act at once, before an interlocking that asks one train after another."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.rail.interlocking.asking import STOP
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.world import MOVE_FORWARD, N_ACTIONS, STOP_MOVING, World


def _mask(bits: int) -> NDArray[np.int8]:
    mask = (bits >> np.arange(N_ACTIONS) & 1).astype(np.int8)
    mask.flags.writeable = False
    return mask


MASKS = [_mask(bits) for bits in range(ALL_ACTIONS + 1)]  # [A], 1 for an action that is allowed, by its bits
FORWARD_ONLY = MASKS[1 << MOVE_FORWARD]


def grant_all(world: World, actions: NDArray[np.int8]) -> set[int]:
    """Ask the deciding trains of slot 0, in turn, for the actions [1, N] that their agents chose.

    An action that is not granted, or not any more, becomes STOP_MOVING, or what the train is bound to; returns the
    trains that were refused.
    """
    refused = set()
    asking = world.ask(0)
    for train, allowed in asking:
        if not allowed >> int(actions[0, train]) & 1:
            actions[0, train] = STOP_MOVING if allowed & STOP else int(allowed).bit_length() - 1
            refused.add(train)
        asking.grant(train, int(actions[0, train]))
    return refused
