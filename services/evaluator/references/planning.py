# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Planning trains one after the other, each the fastest way through the cells and times that those before it leave.

"Cooperative Pathfinding", Silver (AIIDE 2005): cooperative A*, a search in space and time with a table of
reservations. Trains of speed 1 that never break down. A step takes a train into another cell, or it waits, on the map or
before it departs. Off the map it is in nobody's way; on the map, by the rules of `common.rail.compiled.step`,

- two trains are never in one cell after the same step, and a cell that one leaves another may enter in that very step;
- two trains never change places in one step;
- a train that arrives is gone after that step, in which nobody else may enter its target; in the next one others may.

So a plan that respects these comes true to the step.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.rail.compiled.arrays import NOTHING, NOWHERE, UNREACHED, Batch
from common.rail.world import DO_NOTHING, STOP_MOVING
from services.evaluator.references.rails import action_out, any_way, can_leave

FREE: Final = -1


class Search(NamedTuple):
    """What searches use again: of T steps in a world of C cells, a node is `time * (4C + 1) + configuration`.

    The configuration 4C is off the map, before departure.

    Attributes:
        seen: [nodes], the number of the search that came here last.
        parents: [nodes], where it came from.
        later: [nodes], the next node on the same list of open ones, or NOTHING.
        open: [T + 1], the first open node for every total of steps so far and steps that are left at least.
    """

    seen: NDArray[np.int32]
    parents: NDArray[np.int64]
    later: NDArray[np.int64]
    open: NDArray[np.int64]


def search_room(steps: int, cells: int) -> Search:
    nodes = (steps + 1) * (cells * 4 + 1)
    return Search(
        seen=np.zeros(nodes, np.int32),
        parents=np.empty(nodes, np.int64),
        later=np.empty(nodes, np.int64),
        open=np.empty(steps + 1, np.int64),
    )


@bare_kernel
def is_reserved(held: NDArray[np.int16], time: int, here: int, there: int) -> bool:
    """Whether a train that is at configuration `here` at a time (NOWHERE: off the map) cannot be `there` one later.

    `held` [T + 1, C]: who is in a cell after so many steps, or FREE.
    """
    if held[time + 1, there >> 2] != FREE:
        return True
    if here == NOWHERE or here >> 2 == there >> 2:
        return False
    other = held[time, there >> 2]
    return other != FREE and held[time + 1, here >> 2] == other


@bare_kernel
def put(search: Search, number: int, node: int, parent: int, total: int) -> None:
    """Open a node, unless this search has done so, or the total is more than there are steps."""
    if total < len(search.open) and search.seen[node] != number:
        search.seen[node] = number
        search.parents[node] = parent
        search.later[node] = search.open[total]
        search.open[total] = node


@bare_kernel
def find(
    codes: NDArray[np.int32],
    leads: NDArray[np.int32],
    distance: NDArray[np.int16],
    start: int,
    earliest: int,
    held: NDArray[np.int16],
    search: Search,
    number: int,
    way: NDArray[np.int32],
) -> int:
    """Find a train's earliest arrival by A*, with the distance on free rails for what is left; NOTHING if there is none.

    Args:
        codes: [4C], of the world, as the next two.
        leads: [4C].
        distance: [4C], to the train's target.
        start: its configuration at departure.
        earliest: steps before it may depart.
        held: [T + 1, C], see `is_reserved`.
        search: room.
        number: of this search, above 0 and never used before with this room.
        way: [T + 1], filled in: its configuration after so many steps, NOWHERE off the map.
    """
    off_map = len(distance)
    width = off_map + 1
    search.open[:] = NOTHING
    if distance[start] == UNREACHED:
        return NOTHING
    put(search, number, earliest * width + off_map, NOTHING, earliest + 1 + distance[start])
    total = 0
    while total < len(search.open):
        node = search.open[total]
        if node == NOTHING:
            total += 1
            continue
        search.open[total] = search.later[node]
        time, here = node // width, node % width
        after = (time + 1) * width
        if here == off_map:
            put(search, number, after + off_map, node, time + 2 + distance[start])
            if time + 1 < len(held) and not is_reserved(held, time, NOWHERE, start):
                put(search, number, after + start, node, time + 1 + distance[start])
        elif distance[here] == 0:
            retrace(search, node, width, way)
            return time
        elif time + 1 < len(held):
            if not is_reserved(held, time, here, here):
                put(search, number, after + here, node, time + 1 + distance[here])
            for out in range(4):
                if can_leave(codes, here, out):
                    there = leads[(here & ~3) + out]
                    if distance[there] != UNREACHED and not is_reserved(held, time, here, there):
                        put(search, number, after + there, node, time + 1 + distance[there])
    return NOTHING


@bare_kernel
def retrace(search: Search, node: int, width: int, way: NDArray[np.int32]) -> None:
    """Write down the way that led to a node."""
    way[:] = NOWHERE
    while node != NOTHING and node % width != width - 1:
        way[node // width] = node % width
        node = search.parents[node]


@kernel
def plan(
    batch: Batch,
    order: NDArray[np.int64],
    earliest: int,
    search: Search,
    first_number: int,
    held: NDArray[np.int16],
    ways: NDArray[np.int32],
    most: int,
) -> int:
    """Plan the trains of slot 0 in an order; the sum of their arrivals, or `most` as soon as it would be that or more.

    Args:
        batch: the world.
        order: [N], of the trains.
        earliest: steps before trains may depart.
        search: room.
        first_number: see `find`; N of them are used up.
        held: [T + 1, C], overwritten.
        ways: [N, T + 1], filled in: configurations after so many steps. Trains without a way stay off the map.
        most: the sum from which on a plan is of no use.
    """
    held[:] = FREE
    steps = len(held) - 1
    spent = 0
    for at in order:
        spent += earliest + 1 + min(int(batch.distances[0, at, batch.trains[0, at]["start"]]), steps)
    for turn, at in enumerate(order):
        start, cells = batch.trains[0, at]["start"], batch.worlds[0]["cells"]
        distance = batch.distances[0, at, : cells * 4]
        way = ways[at]
        arrival = find(batch.codes[0], batch.leads[0], distance, start, earliest, held, search, first_number + turn, way)
        spent += arrival if arrival != NOTHING else 2 * steps
        spent -= earliest + 1 + min(int(distance[start]), steps)
        if spent >= most:
            return most
        if arrival == NOTHING:
            way[:] = NOWHERE
        for time in range(len(way)):
            if way[time] != NOWHERE:
                held[time, way[time] >> 2] = at
    return spent


@kernel
def actions_of(codes: NDArray[np.int32], starts: NDArray[np.int32], ways: NDArray[np.int32]) -> NDArray[np.int8]:
    """[T, N]: what makes trains go these ways [N, T + 1] from their starts [N]."""
    n_trains, times = ways.shape
    actions = np.full((times - 1, n_trains), DO_NOTHING, np.int8)
    for at in range(n_trains):
        for time in range(times - 1):
            here, there = ways[at, time], ways[at, time + 1]
            if there == NOWHERE:
                continue
            if here == NOWHERE:
                actions[time, at] = action_out(codes, starts[at], any_way(codes, starts[at]))
            elif here == there:
                actions[time, at] = STOP_MOVING
            else:
                actions[time, at] = action_out(codes, here, there & 3)
    return actions
