"""Deadlock avoidance: trains keep to their shortest paths, and stop where driving on could end in a jam.

Source: `DeadLockAvoidancePolicy` of flatland-baselines 4.3.0 (MIT licence) with its default settings
(`min_free_cell=1`, opposing trains and switches counted), or with `use_entering_prevention=True` besides; equal to it
action by action. It is stateless but for how far each train has come: its remembered maps are what is computed here.

In every step a train may move unless it has opposing trains: trains that stand on the rest of its path with another
heading. Then for each of them there must be more free cells than there are opposing trains: cells of the path before
the first of them that are no switches, and not on the rest of the other's path.

Entering prevention means to keep one of two trains from departing whose paths leave no free cell. The original counts
free cells from the cell that a train starts from, and stops at once as that is not on the path ahead. So of the trains
that could depart, practically only the one with the highest number does.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.rail.compiled.arrays import DONE, NOTHING, NOWHERE, READY, WAYS, Batch
from common.rail.compiled.paths import count_bits
from common.rail.compiled.world import Parts
from common.rail.world import STOP_MOVING
from services.evaluator.references.performing import Act
from services.evaluator.references.rails import action_out, routes

MIN_FREE_CELLS = 1


def deadlock_avoidance(parts: Parts, *, entering_prevention: bool) -> Act:
    """What trains of a freshly loaded world do."""
    paths, lengths = routes(parts.batch)
    places = np.zeros(len(paths), np.int32)
    actions = np.empty(len(paths), np.int8)

    def act(_step: int) -> NDArray[np.int8]:
        decide(parts.batch, paths, lengths, places, entering_prevention, actions)
        return actions

    return act


@kernel
def decide(
    batch: Batch,
    paths: NDArray[np.int32],
    lengths: NDArray[np.int32],
    places: NDArray[np.int32],
    entering_prevention: bool,
    actions: NDArray[np.int8],
) -> None:
    """Fill in the actions [N] of the trains of slot 0.

    Args:
        batch: the world.
        paths: [N, L], see `routes`.
        lengths: [N].
        places: [N], how far trains have come on them; carried on.
        entering_prevention: see above.
        actions: [N].
    """
    trains, codes = batch.trains[0], batch.codes[0]
    ahead = np.zeros((len(paths), batch.worlds[0]["cells"]), np.bool_)
    for at in range(len(paths)):
        here = trains[at]["config"]
        while here != NOWHERE and paths[at, places[at]] >> 2 != here >> 2:
            places[at] += 1
        for place in range(places[at] + 1, lengths[at]):
            ahead[at, paths[at, place] >> 2] = True
    may = np.zeros(len(paths), np.bool_)
    for at in range(len(paths)):
        rest = paths[at, places[at] + 1 : lengths[at]]
        may[at] = trains[at]["state"] != DONE and len(rest) > 0 and is_free(batch, at, rest, ahead)
    if entering_prevention:
        keep_from_entering(trains, paths, ahead, may)
    for at in range(len(paths)):
        place = places[at]
        actions[at] = action_out(codes, paths[at, place], paths[at, place + 1] & 3) if may[at] else STOP_MOVING


@kernel
def is_free(batch: Batch, at: int, rest: NDArray[np.int32], ahead: NDArray[np.bool_]) -> bool:
    """Whether a train whose `rest` of the path is given may move; `ahead` [N, C] are the cells of all these."""
    opposes = np.zeros(len(ahead), np.bool_)
    before_first = len(rest)
    for place in range(len(rest)):
        other = batch.cells[0, rest[place] >> 2]["train"]
        if other not in (NOTHING, at) and batch.trains[0, other]["config"] != rest[place]:
            opposes[other] = True
            before_first = min(before_first, place)
    needed = MIN_FREE_CELLS + opposes.sum()
    for other in range(len(ahead)):
        if opposes[other]:
            free = 0
            for place in range(before_first):
                cell = rest[place] >> 2
                again = False
                for earlier in rest[:place]:
                    again = again or earlier >> 2 == cell
                if not again and not ahead[other, cell] and not is_switch(batch.codes[0], cell):
                    free += 1
            if free < needed:
                return False
    return True


@bare_kernel
def is_switch(codes: NDArray[np.int32], cell: int) -> bool:
    """Whether some train has a choice there."""
    for here in range(cell * 4, cell * 4 + 4):
        if count_bits(codes[here] & WAYS) > 1:
            return True
    return False


@kernel
def keep_from_entering(
    trains: NDArray[np.void], paths: NDArray[np.int32], ahead: NDArray[np.bool_], may: NDArray[np.bool_]
) -> None:
    """Forbid trains to depart that get into the way of another one that could."""
    entering = np.zeros(len(may), np.bool_)
    for at in range(len(may)):
        entering[at] = may[at] and trains[at]["state"] == READY
    for at in range(len(may)):
        for other in range(len(may)):
            if at != other and entering[at] and entering[other] and may[at] and may[other]:
                start = paths[at, 0] >> 2
                is_theirs = ahead[other, start] or paths[other, 0] >> 2 == start
                may[at] = ahead[at, start] and not is_theirs
