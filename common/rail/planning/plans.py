"""Plans for all trains of a world, one train after the other in some order, and what carries them out."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.rail.compiled.arrays import DONE, NOTHING, NOWHERE, Batch
from railctl.common.rail.planning.rails import action_out, any_way
from railctl.common.rail.planning.search import ANYTHING, FREE, Room, find, ready, soonest
from railctl.common.rail.world import DO_NOTHING, STOP_MOVING


@bare_kernel
def stand(batch: Batch, slot: int, at: int, room: Room, last: int, way: NDArray[np.int32]) -> None:
    """A train stays where it is until some step: where the place is free, it is reserved."""
    here = int(batch.trains[slot, at]["config"])
    for time in range(last + 1):
        way[time] = here
        if here != NOWHERE and room.held[time, here >> 2] == FREE:
            room.held[time, here >> 2] = at


@bare_kernel
def plan(
    batch: Batch,
    slot: int,
    order: NDArray[np.int64],
    room: Room,
    steps: int,
    anywhere: bool,
    ways: NDArray[np.int32],
    arrivals: NDArray[np.int32],
    mover: int,
    first: int,
    enough: int,
) -> int:
    """Plan trains in an order; the sum of their arrivals, of which one that fails is twice the time.

    Args:
        batch: the world.
        slot: in which it is.
        order: of the trains that have not arrived.
        room: its reservations are overwritten.
        steps: the last time that counts.
        anywhere: see `find`.
        ways: [N, at least `steps` + 1], filled in for the trains of the order: see `find`. Those that cannot arrive
            stay where they are.
        arrivals: [N], filled in as well: after so many steps, NOTHING for those that cannot in time.
        mover: a train of which the first move is given, or NOTHING,
        first: and that move, see `find`.
        enough: once the sum cannot get below this the plan is given up, and this is returned.
    """
    room.held[: steps + 1] = FREE
    spent = 0  # at least
    for at in order:
        spent += soonest(batch, slot, at, steps)
        stand(batch, slot, at, room, min(steps, ready(batch, slot, at)), ways[at])
    for at in order:
        if spent >= enough:
            return enough
        arrival = find(batch, slot, at, room, steps, anywhere, first if at == mover else ANYTHING, ways[at])
        arrivals[at] = arrival
        spent += (arrival if arrival != NOTHING else 2 * steps) - soonest(batch, slot, at, steps)
        if arrival == NOTHING:
            stand(batch, slot, at, room, steps, ways[at])
        for time in range(arrival + 1):
            if ways[at, time] != NOWHERE:
                room.held[time, ways[at, time] >> 2] = at
    return min(spent, enough)


@bare_kernel
def by_distance(batch: Batch, slot: int, order: NDArray[np.int64]) -> int:
    """Fill in the trains that have not arrived, the nearest to its target first, the lowest of equals; how many."""
    count = 0
    for at in range(batch.worlds[slot]["trains"]):
        if batch.trains[slot, at]["state"] == DONE:
            continue
        place, distance = count, distance_left(batch, slot, at)
        while place > 0 and distance_left(batch, slot, order[place - 1]) > distance:
            order[place] = order[place - 1]
            place -= 1
        order[place] = at
        count += 1
    return count


@bare_kernel
def distance_left(batch: Batch, slot: int, at: int) -> int:
    """The cells to a train's target, from where it starts if it is off the map."""
    train = batch.trains[slot, at]
    here = train["start"] if train["config"] == NOWHERE else train["config"]
    return int(batch.distances[slot, at, here])


@kernel
def actions_for(codes: NDArray[np.int32], starts: NDArray[np.int32], ways: NDArray[np.int32]) -> NDArray[np.int8]:
    """[T, N]: what makes trains of speed 1 go these ways [N, T + 1] from their starts [N]."""
    n_trains, times = ways.shape
    actions = np.full((times - 1, n_trains), DO_NOTHING, np.int8)
    for at in range(n_trains):
        for time in range(times - 1):
            here, there = ways[at, time], ways[at, time + 1]
            if there == NOWHERE:
                continue
            if here == NOWHERE:  # to depart takes any action that could drive on
                actions[time, at] = action_out(codes, starts[at], any_way(codes, starts[at]))
            elif here == there:
                actions[time, at] = STOP_MOVING
            else:
                actions[time, at] = action_out(codes, here, there & 3)
    return actions
