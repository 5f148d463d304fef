"""Planning trains one after the other, each the fastest way through the cells and times that those before it leave.

"Cooperative Pathfinding", Silver (AIIDE 2005): cooperative A*, a search in space and time over a table of reservations.
For trains of speed 1 that never break down. In a step a train goes into another cell, or it waits, on the map or before
it departs. Off the map it is in nobody's way; on the map, by the rules of `common.rail.compiled.step`,

- two trains are never in one cell after the same step; what one leaves, another may enter in that very step;
- two trains never change places in one step;
- a train that arrives is gone after that step. Nobody else enters its target in the same step; in the next others may.

So a plan that keeps to this comes true to the step.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.rail.compiled.arrays import NOTHING, NOWHERE, UNREACHED, WAITING, Batch
from common.rail.world import DO_NOTHING, STOP_MOVING
from services.evaluator.references.rails import action_out, any_way, can_leave

FREE: Final = -1


class Room(NamedTuple):
    """What planning T steps in a world of C cells needs, and may use again.

    A node is `time * (4C + 1) + configuration`, the configuration 4C being off the map before departure. Its total is
    the time and what is left at least. Nodes of an equal total are a list, the newest first.

    Attributes:
        held: [T + 1, C], which train is in a cell after so many steps, or FREE.
        open: [T + 1], the first node to look at of every total, or NOTHING.
        later: [nodes], the next one on its list, or NOTHING.
        parents: [nodes], where the search came from.
        seen: [nodes], which search came here last.
        searches: [1], how many there have been.
    """

    held: NDArray[np.int16]
    open: NDArray[np.int64]
    later: NDArray[np.int64]
    parents: NDArray[np.int64]
    seen: NDArray[np.int32]
    searches: NDArray[np.int32]


def room_for(steps: int, cells: int) -> Room:
    nodes = (steps + 1) * (cells * 4 + 1)
    return Room(
        held=np.full((steps + 1, cells), FREE, np.int16),
        open=np.empty(steps + 1, np.int64),
        later=np.empty(nodes, np.int64),
        parents=np.empty(nodes, np.int64),
        seen=np.zeros(nodes, np.int32),
        searches=np.zeros(1, np.int32),
    )


@bare_kernel
def is_reserved(held: NDArray[np.int16], time: int, here: int, there: int) -> bool:
    """Whether a train that is in a configuration at a time, or NOWHERE, cannot be `there` one step later."""
    if held[time + 1, there >> 2] != FREE:
        return True
    if here == NOWHERE or here >> 2 == there >> 2:
        return False
    other = held[time, there >> 2]
    return bool(other != FREE and held[time + 1, here >> 2] == other)


@bare_kernel
def reach(room: Room, node: int, total: int, parent: int) -> None:
    """Put a node on its list, unless this search was there before, or there are fewer steps than its total."""
    if total < len(room.open) and room.seen[node] != room.searches[0]:
        room.seen[node] = room.searches[0]
        room.parents[node] = parent
        room.later[node] = room.open[total]
        room.open[total] = node


@bare_kernel
def ready(train: np.void) -> int:
    """The steps after which a train may depart in the next; under legacy rules it may at once."""
    return max(1, int(train["departure"])) if train["state"] == WAITING else 0


@bare_kernel
def soonest(batch: Batch, at: int, steps: int) -> int:
    """The step after which a train that were alone would have arrived, twice the steps there are if it could not."""
    train = batch.trains[0, at]
    arrival = ready(train) + 1 + batch.distances[0, at, train["start"]]
    return int(arrival) if arrival <= steps else 2 * steps


@bare_kernel
def find(batch: Batch, at: int, room: Room, way: NDArray[np.int32]) -> int:  # noqa: C901  (one search)
    """When a train can arrive at the earliest, by A* with the distance on free rails; NOTHING if it cannot in time.

    Args:
        batch: the world, in slot 0.
        at: the train.
        room: with the reservations of others.
        way: [T + 1], filled in: its configuration after so many steps, NOWHERE off the map.
    """
    codes, leads, distance = batch.codes[0], batch.leads[0], batch.distances[0, at]
    off_map = int(batch.worlds[0]["cells"]) * 4
    width = off_map + 1
    start = int(batch.trains[0, at]["start"])
    earliest = ready(batch.trains[0, at])
    way[:] = NOWHERE
    room.open[:] = NOTHING
    room.searches[0] += 1
    if distance[start] != UNREACHED:
        reach(room, earliest * width + off_map, earliest + 1 + distance[start], NOTHING)
    total = 0
    while total < len(room.open):
        node = room.open[total]
        if node == NOTHING:
            total += 1
            continue
        room.open[total] = room.later[node]
        time, here = node // width, node % width
        if here != off_map and distance[here] == 0:
            while here != off_map:
                way[node // width] = here
                node = room.parents[node]
                here = node % width
            return int(time)
        if time + 1 == len(way):
            continue
        after = (time + 1) * width
        if here == off_map:
            reach(room, after + off_map, time + 2 + distance[start], node)
            if not is_reserved(room.held, time, NOWHERE, start):
                reach(room, after + start, time + 1 + distance[start], node)
            continue
        if not is_reserved(room.held, time, here, here):
            reach(room, after + here, time + 1 + distance[here], node)
        for out in range(4):
            if can_leave(codes, here, out):
                there = leads[(here & ~3) + out]
                if distance[there] != UNREACHED and not is_reserved(room.held, time, here, there):
                    reach(room, after + there, time + 1 + distance[there], node)
    return NOTHING


@bare_kernel
def plan(batch: Batch, order: NDArray[np.int64], room: Room, ways: NDArray[np.int32], enough: int) -> int:
    """Plan the trains of slot 0 in an order; the sum of their arrivals, of which one that fails is twice the time.

    Args:
        batch: the world.
        order: [N], of the trains.
        room: its reservations are overwritten.
        ways: [N, T + 1], filled in: see `find`. Trains that cannot arrive stay off the map.
        enough: once the sum cannot get below this the plan is given up, and this is returned.
    """
    steps = len(room.open) - 1
    room.held.reshape(room.held.size)[:] = FREE
    spent = 0  # at least
    for at in order:
        spent += soonest(batch, at, steps)
    for at in order:
        if spent >= enough:
            return enough
        arrival = find(batch, at, room, ways[at])
        spent += (arrival if arrival != NOTHING else 2 * steps) - soonest(batch, at, steps)
        for time in range(steps + 1):
            if ways[at, time] != NOWHERE:
                room.held[time, ways[at, time] >> 2] = at
    return min(spent, enough)


@kernel
def actions_for(codes: NDArray[np.int32], starts: NDArray[np.int32], ways: NDArray[np.int32]) -> NDArray[np.int8]:
    """[T, N]: what makes trains go these ways [N, T + 1] from their starts [N]."""
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
