"""Deadlock avoidance: trains keep to their shortest paths, and stop where driving on could end in a jam.

Source: `DeadLockAvoidancePolicy` of flatland-baselines 4.3.0 (MIT licence) with its default settings
(`min_free_cell=1`, opposing trains and switches counted), or with `use_entering_prevention=True` besides; equal to it
action by action. What the original remembers depends on nothing but how far each train has come on its path, so it is
computed anew in every step. Its alternative paths, which these settings do not use, are left out.

A train may move unless it has opposing trains: trains that stand on the rest of its path with another heading. Then for
each of them there must be more free cells than there are opposing trains: cells of the path before the first of them
that are no switches, and not on the rest of the other's path.

Entering prevention means to keep one of two trains from departing whose paths leave no free cell between them. The
original counts free cells from where a train starts, and that cell, not being ahead of it, ends the count. So of the
trains that could depart only the one with the highest number does, unless a path comes back to its start.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.rail.compiled.arrays import DONE, NOTHING, NOWHERE, READY, UNREACHED, WAYS, Batch
from railctl.common.rail.compiled.paths import count_bits
from railctl.common.rail.compiled.world import Parts
from railctl.common.rail.planning.rails import action_out, shortest_way
from railctl.common.rail.world import STOP_MOVING
from railctl.services.evaluator.references.performing import Act

MIN_FREE_CELLS = 1


class Journeys(NamedTuple):
    """The ways of N trains.

    Attributes:
        paths: [N, L], configurations from the start to the target, the rest of a row NOTHING.
        lengths: [N], of the paths, 0 if there is none.
        places: [N], how far trains have come.
    """

    paths: NDArray[np.int32]
    lengths: NDArray[np.int32]
    places: NDArray[np.int32]


def deadlock_avoidance(_index: int, parts: Parts, *, entering_prevention: bool) -> Act:
    """What the trains of a freshly loaded world do."""
    journeys = set_out(parts.batch)
    actions = np.empty(len(journeys.paths), np.int8)

    def act(_step: int) -> NDArray[np.int8]:
        decide(parts.batch, journeys, entering_prevention, actions)
        return actions

    return act


@kernel
def set_out(batch: Batch) -> Journeys:
    """The shortest paths of the trains of slot 0; of equally short ways the lowest (north, east, south, west)."""
    trains = batch.trains[0][: batch.worlds[0]["trains"]]
    codes, leads, distances = batch.codes[0], batch.leads[0], batch.distances[0]
    lengths = np.zeros(len(trains), np.int32)
    for at in range(len(trains)):
        distance = distances[at, trains[at]["start"]]
        lengths[at] = 0 if distance == UNREACHED else distance + 1
    paths = np.full((len(trains), max(1, lengths.max())), NOTHING, np.int32)
    for at in range(len(trains)):
        here = int(trains[at]["start"])
        for place in range(lengths[at]):
            paths[at, place] = here
            if place + 1 < lengths[at]:
                here = int(leads[(here & ~3) + shortest_way(codes, leads, distances[at], here, 0)])
    return Journeys(paths, lengths, np.zeros(len(trains), np.int32))


@kernel
def decide(batch: Batch, journeys: Journeys, entering_prevention: bool, actions: NDArray[np.int8]) -> None:
    """Fill in the actions [N] of the trains of slot 0; `journeys` are carried on."""
    trains, codes = batch.trains[0], batch.codes[0]
    paths, places = journeys.paths, journeys.places
    ahead = np.zeros((len(paths), batch.worlds[0]["cells"]), np.bool_)
    for at in range(len(paths)):
        here = trains[at]["config"]
        while here != NOWHERE and paths[at, places[at]] >> 2 != here >> 2:
            places[at] += 1
        for place in range(places[at] + 1, journeys.lengths[at]):
            ahead[at, paths[at, place] >> 2] = True
    may = np.zeros(len(paths), np.bool_)
    for at in range(len(paths)):
        rest = paths[at, places[at] + 1 : journeys.lengths[at]]
        may[at] = trains[at]["state"] != DONE and len(rest) > 0 and is_free(batch, at, rest, ahead)
    if entering_prevention:
        keep_from_entering(trains, paths, ahead, may)
    for at in range(len(paths)):
        place = places[at]
        actions[at] = action_out(codes, paths[at, place], paths[at, place + 1] & 3) if may[at] else STOP_MOVING


@kernel
def is_free(batch: Batch, at: int, rest: NDArray[np.int32], ahead: NDArray[np.bool_]) -> bool:
    """Whether a train with this `rest` of its path may move; `ahead` [N, C] are the cells on the rests of all paths."""
    opposing = np.zeros(len(ahead), np.bool_)
    before_first = len(rest)
    for place in range(len(rest)):
        other = batch.cells[0, rest[place] >> 2]["train"]
        if other not in (NOTHING, at) and batch.trains[0, other]["config"] != rest[place]:
            opposing[other] = True
            before_first = min(before_first, place)
    needed = MIN_FREE_CELLS + opposing.sum()
    for other in range(len(ahead)):
        if opposing[other] and free_cells(batch.codes[0], rest[:before_first], ahead[other]) < needed:
            return False
    return True


@kernel
def free_cells(codes: NDArray[np.int32], stretch: NDArray[np.int32], taken: NDArray[np.bool_]) -> int:
    """How many cells of a stretch of configurations are no switches, and not `taken` [C]."""
    free = 0
    for place in range(len(stretch)):
        cell = stretch[place] >> 2
        is_new = True
        for earlier in range(place):
            is_new = is_new and stretch[earlier] >> 2 != cell
        if is_new and not taken[cell] and not is_switch(codes, cell):
            free += 1
    return free


@bare_kernel
def is_switch(codes: NDArray[np.int32], cell: int) -> bool:
    """Whether a train has a choice there, wherever it comes from."""
    most = 0
    for here in range(cell * 4, cell * 4 + 4):
        most = max(most, count_bits(codes[here] & WAYS))
    return most > 1


@kernel
def keep_from_entering(
    trains: NDArray[np.void], paths: NDArray[np.int32], ahead: NDArray[np.bool_], may: NDArray[np.bool_]
) -> None:
    """Forbid trains to depart as long as another one could that they get in the way of."""
    entering = np.zeros(len(may), np.bool_)
    for at in range(len(may)):
        entering[at] = may[at] and trains[at]["state"] == READY
    for at in range(len(may)):
        for other in range(len(may)):
            if at != other and entering[at] and entering[other] and may[at] and may[other]:
                start = paths[at, 0] >> 2
                is_theirs = ahead[other, start] or paths[other, 0] >> 2 == start
                may[at] = ahead[at, start] and not is_theirs
