"""The fastest way of one train through the cells and times that others leave, from where it is.

"Cooperative Pathfinding", Silver (AIIDE 2005): cooperative A*, a search in space and time over a table of reservations.
At the end of a cell a train goes into another one, or it waits; off the map it may wait to depart. Off the map it is in
nobody's way; on the map, by the rules of `common.rail.compiled.step`,

- two trains are never in one cell after the same step; what one leaves, another may enter in that very step;
- two trains never change places in one step;
- a train that arrives is gone after that step. Nobody else enters its target in the same step; in the next others may.

Where a train may not choose to wait it still stands as long as the cell ahead of it stays taken, as it would in the
world. So a plan that keeps to this comes true to the step, if trains do not break down any more and a cell takes each
of them a whole number of steps; if not, that number is rounded up.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import DECIDES, NOTHING, NOWHERE, READY, UNREACHED, WAITING, Batch
from railctl.common.rail.compiled.step import leave
from railctl.common.rail.planning.rails import can_leave
from railctl.common.rail.world import MOVE_FORWARD

FREE: Final = -1
ANYTHING: Final = -2  # that a train does first
LAST_SEARCH: Final = int(np.iinfo(np.int32).max)


class Room(NamedTuple):
    """What planning T steps in a world of C cells needs, and may use again.

    A node is `time * (4C + 1) + configuration`: a train at the end of a cell; the configuration 4C is off the map
    before departure. Its total is the time and what is left at least. Nodes of an equal total are a list, the newest
    first.

    Attributes:
        held: [T + 1, C], which train is in a cell after so many steps, or FREE.
        open: [T + 1], the first node to look at of every total, or NOTHING.
        later: [nodes], the next one on its list, or NOTHING.
        parents: [nodes], where the search came from.
        seen: [nodes], which search came here last.
        searches: [1], how many there have been.
    """

    held: NDArray[np.int16]
    open: NDArray[np.int32]
    later: NDArray[np.int32]
    parents: NDArray[np.int32]
    seen: NDArray[np.int32]
    searches: NDArray[np.int32]


def room_for(steps: int, cells: int) -> Room:
    """Room for plans of so many steps in any world of so many cells.

    Raises:
        ValueError: these are more nodes than can be numbered.
    """
    nodes = (steps + 1) * (cells * 4 + 1)
    if nodes > np.iinfo(np.int32).max:
        raise ValueError(
            f"planning {steps} steps in {cells} cells takes {nodes} nodes, {np.iinfo(np.int32).max} are supported"
        )
    return Room(
        held=np.full((steps + 1, cells), FREE, np.int16),
        open=np.empty(steps + 1, np.int32),
        later=np.empty(nodes, np.int32),
        parents=np.empty(nodes, np.int32),
        seen=np.zeros(nodes, np.int32),
        searches=np.zeros(1, np.int32),
    )


@bare_kernel
def pace(batch: Batch, slot: int, at: int) -> int:
    """The steps that a train takes for a cell."""
    unit, speed = int(batch.worlds[slot]["unit"]), int(batch.trains[slot, at]["full_speed"])
    return (unit + speed - 1) // speed


@bare_kernel
def ready(batch: Batch, slot: int, at: int) -> int:
    """The steps from now after which a train is at the end of its cell, or may depart, if nobody hinders it."""
    train, world = batch.trains[slot, at], batch.worlds[slot]
    broken, speed = int(train["malfunction"]), int(train["full_speed"])
    if train["config"] != NOWHERE:
        left = int(world["unit"]) - int(train["distance"])
        return broken + max(0, (left + speed - 1) // speed - 1)
    if train["state"] == READY:
        return broken
    wait = int(train["departure"]) - int(world["time"])
    return max(broken, wait, 1 if train["state"] == WAITING else 0)


@bare_kernel
def is_at_end(batch: Batch, slot: int, at: int) -> bool:
    """Whether a train on the map has come to the end of its cell."""
    train = batch.trains[slot, at]
    return bool(train["distance"] + train["full_speed"] >= batch.worlds[slot]["unit"])


@bare_kernel
def arrival(time: int, distance: int, steps_per_cell: int) -> int:
    """When a train that is at the end of a cell after so many steps arrives at the earliest."""
    return time if distance == 0 else time + (distance - 1) * steps_per_cell + 1


@bare_kernel
def departed(time: int, distance: int, steps_per_cell: int) -> int:
    """When a train arrives at the earliest that departs in the step after so many."""
    return time + 1 + distance * steps_per_cell


@bare_kernel
def soonest(batch: Batch, slot: int, at: int, steps: int) -> int:
    """The step after which a train that were alone would have arrived, twice the steps there are if it could not."""
    train, distance = batch.trains[slot, at], batch.distances[slot, at]
    here, first = int(train["config"]), ready(batch, slot, at)
    if here == NOWHERE:
        distance_left = int(distance[train["start"]])
        best = departed(first, distance_left, pace(batch, slot, at))
    else:
        distance_left = int(distance[here])
        best = arrival(first, distance_left, pace(batch, slot, at))
    return best if distance_left != UNREACHED and best <= steps else 2 * steps


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
def is_taken(held: NDArray[np.int16], first: int, last: int, cell: int) -> bool:
    """Whether a train is in a cell some time from one step to another."""
    time = first
    while time <= last and held[time, cell] == FREE:
        time += 1
    return time <= last


@bare_kernel
def halts(batch: Batch, slot: int, here: int) -> bool:
    """Whether a train stops for good where it is before the end of a cell.

    All trains are told to drive straight on there, and a cell in which rails only branch off to both sides has no such
    way. Trains of speed 1 are at the end of a cell as soon as they enter it.
    """
    return bool(leave(batch.codes[slot], batch.leads[slot], here, MOVE_FORWARD) == NOTHING)


@bare_kernel
def begin_search(room: Room) -> None:
    """Number a search; from the last number there is it goes back to the first."""
    if room.searches[0] == LAST_SEARCH:
        room.seen[:] = 0
        room.searches[0] = 0
    room.searches[0] += 1


@bare_kernel
def reach(room: Room, node: int, total: int, parent: int) -> None:
    """Put a node on its list, unless this search was there before."""
    if room.seen[node] != room.searches[0]:
        room.seen[node] = room.searches[0]
        room.parents[node] = parent
        room.later[node] = room.open[total]
        room.open[total] = node


@bare_kernel
def trace(room: Room, node: int, width: int, way: NDArray[np.int32]) -> None:
    """Fill in the way that leads to a node, from the time before its first."""
    while node != NOTHING:
        parent, here = int(room.parents[node]), node % width
        before = parent // width if parent != NOTHING else NOTHING
        if here != width - 1:
            for time in range(before + 1, node // width + 1):
                way[time] = here
        node = parent


@bare_kernel
def find(
    batch: Batch, slot: int, at: int, room: Room, steps: int, anywhere: bool, first: int, way: NDArray[np.int32]
) -> int:
    """When a train can arrive at the earliest, by A* with the distance on free rails; NOTHING if it cannot in time.

    Args:
        batch: the world.
        slot: in which it is.
        at: the train.
        room: with the reservations of others, and its own until it can do something.
        steps: the last time it may arrive.
        anywhere: it may wait on every cell, not only where it decides by `common.rail.decisions`.
        first: the configuration that it goes to first, as soon as that is free, where it is to wait a step, NOWHERE to
            wait off the map; or ANYTHING. Trains that do not decide now do what they have to.
        way: [at least `steps` + 1], filled in that far: its configuration after so many steps, NOWHERE off the map.
    """
    codes, leads, distance = batch.codes[slot], batch.leads[slot], batch.distances[slot, at]
    train, held = batch.trains[slot, at], room.held
    off_map = int(batch.worlds[slot]["cells"]) * 4
    width = off_map + 1
    start, origin = int(train["start"]), int(train["config"])
    committed = NOTHING
    hindered = train["committed"] if train["committed"] != NOTHING else train["bound"]
    if origin != NOWHERE and hindered != NOTHING:
        committed = leave(codes, leads, origin, int(hindered))
    elif first > ANYTHING and first != origin:
        committed = first
    per_cell, earliest = pace(batch, slot, at), ready(batch, slot, at)
    way[: steps + 1] = NOWHERE
    room.open[: steps + 1] = NOTHING
    begin_search(room)
    total = soonest(batch, slot, at, steps)
    if origin != NOWHERE and not is_at_end(batch, slot, at) and halts(batch, slot, origin):
        total = 2 * steps
    if total <= steps:
        reach(room, earliest * width + (off_map if origin == NOWHERE else origin), total, NOTHING)
    while total <= steps:
        node = int(room.open[total])
        if node == NOTHING:
            total += 1
            continue
        room.open[total] = room.later[node]
        time, here = node // width, node % width
        after = (time + 1) * width
        must_wait = first == origin and time == earliest
        if here == off_map:
            if total < steps and (committed == NOTHING or held[time + 1, start >> 2] != FREE):
                reach(room, after + off_map, total + 1, node)
            if must_wait:
                continue
            if per_cell > 1 and distance[start] != 0 and halts(batch, slot, start):
                continue
            entered = time + (1 if distance[start] == 0 else per_cell)
            if not is_taken(held, time + 1, entered, start >> 2):
                reach(room, entered * width + start, total, node)
            continue
        if distance[here] == 0:
            trace(room, node, width, way)
            return time
        is_bound = committed != NOTHING and here == origin
        may_wait = not is_bound and (anywhere or codes[here] & DECIDES != 0)
        if may_wait and total < steps and held[time + 1, here >> 2] == FREE:
            reach(room, after + here, total + 1, node)
        for out in range(4):
            if must_wait or not can_leave(codes, here, out):
                continue
            there = int(leads[(here & ~3) + out])
            if distance[there] == UNREACHED or (is_bound and there != committed):
                continue
            if per_cell > 1 and distance[there] != 0 and halts(batch, slot, there):
                continue
            entered = time + (1 if distance[there] == 0 else per_cell)
            expected = arrival(entered, int(distance[there]), per_cell)
            is_free = not is_reserved(held, time, here, there)
            if is_free and expected <= steps and not is_taken(held, time + 2, entered, there >> 2):
                reach(room, entered * width + there, expected, node)
            stands = not may_wait and total < steps and held[time + 1, here >> 2] == FREE
            if stands and held[time, there >> 2] != FREE and held[time, there >> 2] == held[time + 1, there >> 2]:
                reach(room, after + here, total + 1, node)
    return NOTHING
