# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Proofs that all trains on the map can still run to their targets.

A train *claims* the cells from where it rests to the end of its route. It can run home if nobody else rests before it
on its route, and nobody else claims what comes after. Whoever is home claims nothing any more, so others may be able to
then: the banker's algorithm (Dijkstra, "Een algorithme ter voorkoming van de dodelijke omarming", EWD 108, 1965-67),
with cells for money. If all get home in some order the state is *safe*. It is sound: the first of this order may be
granted the first move of its way home, after which the others claim no more than before, so this is safe too; somebody
can always move.

Running home in one go is more than must be possible. A state is also *planned* if all get home once one train has been
moved to some other place where it may rest, while the others stand. That is sound for the same reason: on its way there
the same place is still to be found, since others only come to claim less.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE, SINGLE, UNREACHED, Batch
from railctl.common.rail.compiled.decisions import decides_there
from railctl.common.rail.compiled.ways import nearer
from railctl.common.rail.interlocking.signals import DECISIONS, PLACES, QUEUE, SEARCHES, STAMPS, Signals

UNKNOWN: int = -2  # where a train rests
LAST_SEARCH: int = 2**31 - 1  # that fits into 32 bits; then they are counted anew


@bare_kernel
def settle(batch: Batch, slot: int, signals: Signals) -> None:
    """Find out where all trains of a slot come to rest, and what they claim."""
    trains, cells, routes, distances = signals.trains, signals.cells, signals.routes, batch.distances[slot]
    n_trains, unknown = batch.worlds[slot]["trains"], 0
    for at in range(n_trains):
        length = trains[at]["length"]
        if length == 1 and distances[at, routes[at, 0]] != 0:  # it stands
            trains[at]["rest"] = 0
            stand(cells, routes[at], 0, 1, at)
        else:
            trains[at]["rest"] = UNKNOWN if length else NOTHING
            unknown += length > 0
    for again in range(n_trains + 1):
        if unknown == 0:
            return
        for at in range(n_trains):
            of = trains[at]
            if of["rest"] == UNKNOWN:
                rest = resting_place(trains, cells, routes[at], of["length"], at)
                if rest == UNKNOWN and again == n_trains:
                    rest = 0  # who waits for itself
                if rest != UNKNOWN:
                    unknown -= 1
                    end = of["length"] - 1
                    if rest == end and distances[at, routes[at, end]] == 0:
                        of["rest"] = NOTHING
                    else:
                        of["rest"] = rest
                        stand(cells, routes[at], rest, of["length"], at)


@bare_kernel
def resting_place(
    trains: NDArray[np.void], cells: NDArray[np.void], route: NDArray[np.int32], length: int, at: int
) -> int:
    """The place on its route where a train rests, UNKNOWN as long as that of somebody before it is."""
    for place in range(1, length):
        cell = cells[route[place] >> 2]
        other = cell["occupant"]
        if other >= 0 and other != at and trains[other]["rest"] == UNKNOWN:
            return UNKNOWN
        if cell["resting"] != NOTHING:
            return place - 1
    return length - 1


@bare_kernel
def stand(cells: NDArray[np.void], route: NDArray[np.int32], rest: int, length: int, at: int) -> None:
    """A train rests at a place of its route, and claims it and what comes after."""
    cells[route[rest] >> 2]["resting"] = at
    for place in range(rest, length):
        cells[route[place] >> 2]["claims"] += 1


@bare_kernel
def vanish(cells: NDArray[np.void], route: NDArray[np.int32], rest: int, length: int) -> None:
    """Undo `stand`."""
    cells[route[rest] >> 2]["resting"] = NOTHING
    for place in range(rest, length):
        cells[route[place] >> 2]["claims"] -= 1


@bare_kernel
def is_proven(batch: Batch, slot: int, signals: Signals, mover: int, steps_aside: bool) -> bool:
    """Whether all trains get home from where they rest, if `steps_aside` once one has been moved; undoes `settle`.

    A `mover` is a train, or NOTHING, that has moved since this was last so: once it gets home itself, it is so again.
    """
    trains, n_trains = signals.trains, batch.worlds[slot]["trains"]
    remain = 0
    for at in range(n_trains):
        trains[at]["left"] = trains[at]["rest"] != NOTHING
        remain += trains[at]["left"]
    proven = remain == 0
    if mover != NOTHING and not proven:
        proven = not trains[mover]["left"]
        for detour in range(2):
            if not proven and runs_home(batch, slot, signals, mover, not detour):
                trains[mover]["left"], proven = False, True
    if not proven:
        home = send_home(batch, slot, signals, 0, remain)
        remain -= home
        proven = remain == 0 or (steps_aside and somebody_steps_aside(batch, slot, signals, home, remain))
    for at in range(n_trains):
        if trains[at]["left"]:
            vanish(signals.cells, signals.routes[at], trains[at]["rest"], trains[at]["length"])
    return proven


@bare_kernel
def send_home(batch: Batch, slot: int, signals: Signals, count: int, remain: int) -> int:
    """Let everyone run home who can of the `remain` who are left; whoever needs a detour only when nobody else can.

    They are noted after the `count` who got home before; returns how many there are now.
    """
    trains, n_trains = signals.trains, batch.worlds[slot]["trains"]
    end, straight = count + remain, True
    while count != end:
        before = count
        for at in range(n_trains):
            if trains[at]["left"] and runs_home(batch, slot, signals, at, straight):
                trains[at]["left"] = False
                trains[count]["home"] = at
                count += 1
                if not straight:
                    break
        if not straight and count == before:
            break
        straight = count != before
    return count


@bare_kernel
def runs_home(batch: Batch, slot: int, signals: Signals, at: int, straight: bool) -> bool:
    """Whether a train can run home while the others stand, `straight` on the shortest way or on any; then it does."""
    cells, route = signals.cells, signals.routes[at]
    rest, length = int(signals.trains[at]["rest"]), int(signals.trains[at]["length"])
    if is_hindered(cells, route, rest, length):
        return False
    distance, end = batch.distances[slot, at], int(route[length - 1])
    vanish(cells, route, rest, length)
    codes, leads = batch.codes[slot], batch.leads[slot]
    if straight:
        free = is_clear(codes, leads, distance, end, cells)
    else:
        free = search(codes, leads, distance, end, cells, signals.search, signals.numbers) == NOTHING
    if not free:
        stand(cells, route, rest, length, at)
    return free


@bare_kernel
def is_hindered(cells: NDArray[np.void], route: NDArray[np.int32], rest: int, length: int) -> bool:
    """Whether somebody else rests before a train on its route."""
    hindered = False
    for place in range(rest + 1, length):
        hindered = hindered or cells[route[place] >> 2]["resting"] != NOTHING
    return hindered


@bare_kernel
def is_clear(
    codes: NDArray[np.int32],
    leads: NDArray[np.int32],
    distance: NDArray[np.int16],
    end: int,
    cells: NDArray[np.void],
) -> bool:
    """Whether nobody claims a cell of the shortest way from the end of a route to the target."""
    here = end
    while distance[here] != 0:
        here = nearer(codes, leads, distance, here)
        if here == NOWHERE or cells[here >> 2]["claims"] != 0:
            return False
    return True


@bare_kernel
def search(
    codes: NDArray[np.int32],
    leads: NDArray[np.int32],
    distance: NDArray[np.int16],
    end: int,
    cells: NDArray[np.void],
    room: NDArray[np.int32],
    numbers: NDArray[np.int32],
) -> int:
    """Go wherever nobody claims a cell: NOTHING once the target is there, else how many places were seen, as queued."""
    queue, stamps = room[QUEUE], room[STAMPS]
    if numbers[SEARCHES] == LAST_SEARCH:
        stamps[:] = 0
        numbers[SEARCHES] = 0
    numbers[SEARCHES] += 1
    stamp = numbers[SEARCHES]
    queue[0], stamps[end] = end, stamp
    looked, found = 0, 1
    while looked < found:
        here = queue[looked]
        looked += 1
        code = codes[here]
        for way in range(4):
            if code >> way & 1 and (code & SINGLE or way != (here + 2) & 3):
                to = leads[(here & ~3) + way]
                if stamps[to] == stamp or distance[to] == UNREACHED or cells[to >> 2]["claims"] != 0:
                    continue
                if distance[to] == 0:
                    return NOTHING
                stamps[to] = stamp
                queue[found] = to
                found += 1
    return found


@bare_kernel
def somebody_steps_aside(batch: Batch, slot: int, signals: Signals, home: int, remain: int) -> bool:
    """Whether all who are left get home once one of them has been moved; `home` have got there, `remain` are left."""
    trains, cells = signals.trains, signals.cells
    for at in range(batch.worlds[slot]["trains"]):
        of, route = trains[at], signals.routes[at]
        rest, length = int(of["rest"]), int(of["length"])
        if not of["left"] or is_hindered(cells, route, rest, length):
            continue
        vanish(cells, route, rest, length)
        of["rest"], of["length"] = length, length + 1
        proven = gets_out_of_the_way(batch, slot, signals, at, home, remain)
        of["rest"], of["length"] = rest, length
        stand(cells, route, rest, length, at)
        if proven:
            return True
    return False


@bare_kernel
def gets_out_of_the_way(batch: Batch, slot: int, signals: Signals, at: int, home: int, remain: int) -> bool:
    """Whether all who are left get home once a train is anywhere else; that place comes last on its route."""
    codes, numbers, cells, trains = batch.codes[slot], signals.numbers, signals.cells, signals.trains
    route, length = signals.routes[at], int(trains[at]["length"])
    end = int(route[length - 2])
    found = search(codes, batch.leads[slot], batch.distances[slot, at], end, cells, signals.search, numbers)
    places = signals.search[PLACES]
    for number in range(1, found):
        places[number] = signals.search[QUEUE, number]
    for number in range(1, found):
        if not decides_there(codes, int(places[number]), int(numbers[DECISIONS])):
            continue
        route[length - 1] = places[number]
        stand(cells, route, length - 1, length, at)
        count = send_home(batch, slot, signals, home, remain)
        proven = count - home == remain
        while count > home:
            count -= 1
            back = trains[count]["home"]
            trains[back]["left"] = True
            stand(cells, signals.routes[back], trains[back]["rest"], trains[back]["length"], back)
        vanish(cells, route, length - 1, length)
        if proven:
            return True
    return False
