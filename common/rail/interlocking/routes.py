"""Routes: which cells trains hold, so that whatever was granted comes to pass.

A train's *route* is where it is and all that it runs over, unasked, until it is asked again or arrives: after a granted
action it runs on over all cells in which it does not decide. A route is *locked*: another one is only granted if it
touches none, but for three cases.

- It follows: the other train is on it, with the same heading, so that from there both routes are one.
- It joins: the other train is in a cell of it with another heading, and goes on from there as it does itself.
- It waits: of the other's route it touches no more than the cell where that train is, which is left for certain.

What a train has run over it holds no more. So no two trains ever wait for each other on their way, however long they
break down and however slow they are, and everyone gets to where it *rests*: to the end of its route, or to right behind
whoever rests before it. A rail's switches work like this: route locking and sectional release.

Trains decide before every cell with more than two ways (`common.rail.decisions`), so what follows the first cell of a
route is plain track: one track without a switch, which all trains on it leave by the same end.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import AHEAD_SHIFT, NOTHING, NOWHERE, Batch
from railctl.common.rail.compiled.decisions import decides, decides_there
from railctl.common.rail.compiled.step import leave
from railctl.common.rail.interlocking.signals import Signals


@bare_kernel
def run_on(
    codes: NDArray[np.int32],
    distance: NDArray[np.int16],
    route: NDArray[np.int32],
    length: int,
    decisions: int,
) -> int:
    """Complete a route of which the first `length` places are there; returns its length."""
    here = int(route[length - 1])
    while distance[here] != 0 and not decides_there(codes, here, decisions) and length < len(route):
        here = codes[here] >> AHEAD_SHIFT
        route[length] = here
        length += 1
    return length


@bare_kernel
def find_routes(batch: Batch, slot: int, decisions: int, signals: Signals) -> None:
    """The routes of all trains of a slot, before anybody is asked; those who are to be asked stand."""
    world, codes, leads = batch.worlds[slot], batch.codes[slot], batch.leads[slot]
    cells = signals.cells
    for number in range(world["cells"]):
        cell = cells[number]
        cell["occupant"] = cell["resting"] = NOTHING
        cell["locks"] = cell["headings"] = cell["claims"] = 0
    for at in range(world["trains"]):
        train, of, route = batch.trains[slot, at], signals.trains[at], signals.routes[at]
        here = int(train["config"])
        of["length"] = 0
        if here == NOWHERE:
            continue
        route[0] = here
        cells[here >> 2]["occupant"] = at
        length = 1
        hindered = train["committed"] if train["committed"] != NOTHING else train["bound"]
        if hindered != NOTHING:
            to = leave(codes, leads, here, hindered)
            if to != NOTHING:
                route[1] = to
                length = run_on(codes, batch.distances[slot, at], route, 2, decisions)
        elif not decides(train, codes, world["unit"], decisions):
            length = run_on(codes, batch.distances[slot, at], route, 1, decisions)
        lock(cells, of, route, length)


@bare_kernel
def lock(cells: NDArray[np.void], of: np.void, route: NDArray[np.int32], length: int) -> None:
    """Lock what a train's route has more than before, when it had the length that is noted `of` it."""
    turned = False
    for place in range(length):
        here = route[place]
        turned = turned or (place > 0 and (here ^ route[place - 1]) & 3 == 2)  # in a dead end: the way back
        if place >= of["length"]:
            again = False
            if turned:
                for earlier in range(place):
                    again = again or route[earlier] >> 2 == here >> 2
            cells[here >> 2]["locks"] += not again
            cells[here >> 2]["headings"] |= 1 << (here & 3)
    of["length"] = length


@bare_kernel
def is_free(signals: Signals, at: int, first: int, length: int) -> bool:
    """Whether a train's route, from its place `first` on (1 on the map, 0 to depart), may be locked.

    Those who depart get before those whose route leads over where they start, with the same heading.
    """
    cells, trains, routes = signals.cells, signals.trains, signals.routes
    route = routes[at]
    along = 0  # trains whose routes are one with this from here on
    for place in range(first, length):
        here = int(route[place])
        cell = cells[here >> 2]
        bit, other = 1 << (here & 3), int(cell["occupant"])
        headings, locks = int(cell["headings"]), int(cell["locks"])
        if other == at:
            return False
        ahead = other != NOTHING and routes[other, 0] == here
        if other != NOTHING and trains[other]["rest"] == 0 and not (ahead and place):
            return False
        if other != NOTHING and not ahead:
            theirs = 1 << (routes[other, 0] & 3)
            if locks != along + 1 or headings != (theirs | bit if along else theirs):
                return False
            joins = place + 1 < length and trains[other]["length"] > 1 and routes[other, 1] == route[place + 1]
            along += joins
            continue
        if headings & ~bit:
            return False
        if place == 0:  # those who come over here follow
            along = locks
        elif other != NOTHING:
            along += 1
        if locks != along:
            return False
    return True
