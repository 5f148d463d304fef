"""The shortest path behind an interlocking: trains are asked where they decide, one after another.

Each takes the move, of those allowed, beyond which its way to the target is shortest, however long a detour that is;
of equally short ways the leftmost. It waits only if no move is allowed.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import kernel
from railctl.common.rail.asking import unasked
from railctl.common.rail.compiled.arrays import NOTHING
from railctl.common.rail.compiled.world import Parts
from railctl.common.rail.interlocking.asking import allowed, begin, grant, next_asked
from railctl.common.rail.planning.rails import shortest_allowed
from railctl.services.evaluator.references.performing import Act


def interlocked_shortest_path(_index: int, parts: Parts) -> Act:
    """Onward as far as the interlocking of the world allows."""
    actions = np.empty(parts.batch.worlds[0]["trains"], np.int8)

    def act(_step: int) -> NDArray[np.int8]:
        drive_on_as_allowed(parts, actions)
        return actions

    return act


@kernel
def drive_on_as_allowed(parts: Parts, actions: NDArray[np.int8]) -> None:
    """Fill in actions [N] of slot 0."""
    batch, mode, signals, deciding = parts.batch, parts.interlocking, parts.signals, parts.deciding[0]
    for at in range(len(actions)):
        actions[at] = unasked(batch.codes[0], batch.trains[0, at]["config"], mode)
    begin(batch, 0, mode, parts.decisions, signals)
    while True:
        at = next_asked(batch, 0, deciding, signals)
        if at == NOTHING:
            return
        actions[at] = shortest_allowed(batch, 0, at, allowed(batch, 0, mode, at, signals))
        grant(batch, 0, mode, at, actions[at], signals)
