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

from common.kernel import bare_kernel
from common.rail.compiled.arrays import AHEAD_SHIFT, NOTHING, SINGLE, UNREACHED, Batch
from common.rail.interlocking.routes import may_rest
from common.rail.interlocking.signals import SEARCHES, Signals

UNKNOWN: int = -2  # where a train rests


@bare_kernel
def settle(batch: Batch, slot: int, signals: Signals) -> None:
    """Find out where all trains of a slot come to rest, and what they claim."""
    n_trains, unknown = batch.worlds[slot]["trains"], 0
    for at in range(n_trains):
        on_map = signals.lengths[at] > 0
        signals.rests[at] = UNKNOWN if on_map else NOTHING
        unknown += on_map
    for again in range(n_trains + 1):
        if unknown == 0:
            return
        for at in range(n_trains):
            if signals.rests[at] == UNKNOWN:
                rest = resting_place(signals, at)
                if rest == UNKNOWN and again == n_trains:
                    rest = 0  # who waits for itself
                if rest != UNKNOWN:
                    unknown -= 1
                    end = signals.lengths[at] - 1
                    if rest == end and batch.distances[slot, at, signals.routes[at, end]] == 0:
                        signals.rests[at] = NOTHING
                    else:
                        signals.rests[at] = rest
                        stand(signals, at)


@bare_kernel
def resting_place(signals: Signals, at: int) -> int:
    """The place on its route where a train rests, UNKNOWN as long as that of somebody before it is."""
    route, length = signals.routes[at], signals.lengths[at]
    for place in range(1, length):
        cell = route[place] >> 2
        other = signals.occupants[cell]
        if other != NOTHING and other != at and signals.rests[other] == UNKNOWN:
            return UNKNOWN
        if signals.resting[cell] != NOTHING:
            return place - 1
    return int(length) - 1


@bare_kernel
def stand(signals: Signals, at: int) -> None:
    """A train rests where `signals.rests` says."""
    route, rest = signals.routes[at], signals.rests[at]
    signals.resting[route[rest] >> 2] = at
    for place in range(rest, signals.lengths[at]):
        signals.claims[route[place] >> 2] += 1


@bare_kernel
def vanish(signals: Signals, at: int) -> None:
    """Undo `stand`."""
    route, rest = signals.routes[at], signals.rests[at]
    signals.resting[route[rest] >> 2] = NOTHING
    for place in range(rest, signals.lengths[at]):
        signals.claims[route[place] >> 2] -= 1


@bare_kernel
def is_proven(batch: Batch, slot: int, signals: Signals, steps_aside: bool) -> bool:
    """Whether all trains get home from where they rest, if `steps_aside` once one has been moved; undoes `settle`."""
    n_trains = batch.worlds[slot]["trains"]
    for at in range(n_trains):
        signals.left[at] = signals.rests[at] != NOTHING
    home = send_home(batch, slot, signals, 0)
    remain = 0
    for at in range(n_trains):
        remain += signals.left[at]
    proven = remain == 0 or (steps_aside and somebody_steps_aside(batch, slot, signals, home, remain))
    for at in range(n_trains):
        if signals.left[at]:
            vanish(signals, at)
    return proven


@bare_kernel
def send_home(batch: Batch, slot: int, signals: Signals, count: int) -> int:
    """Let everyone run home who can; they are noted in `signals.home`, which had `count`; returns how many it has."""
    n_trains = batch.worlds[slot]["trains"]
    before = -1
    while before != count:
        before = count
        for at in range(n_trains):
            if signals.left[at] and runs_home(batch, slot, signals, at):
                signals.left[at] = False
                signals.home[count] = at
                count += 1
    return count


@bare_kernel
def runs_home(batch: Batch, slot: int, signals: Signals, at: int) -> bool:
    """Whether a train can run home while the others stand; then it does."""
    route, length = signals.routes[at], signals.lengths[at]
    for place in range(signals.rests[at] + 1, length):
        if signals.resting[route[place] >> 2] != NOTHING:
            return False
    distance, end = batch.distances[slot, at], int(route[length - 1])
    vanish(signals, at)
    if distance[end] == 0 or reaches(batch.codes[slot], batch.leads[slot], distance, end, signals):
        return True
    stand(signals, at)
    return False


@bare_kernel
def reaches(
    codes: NDArray[np.int32], leads: NDArray[np.int32], distance: NDArray[np.int16], end: int, signals: Signals
) -> bool:
    """Whether a train can go from the end of its route to its target over cells that nobody claims."""
    claims, here = signals.claims, end
    while distance[here] != 0:  # the shortest way
        here = onward(codes, leads, distance, here)
        if here == NOTHING or claims[here >> 2] != 0:
            break
    else:
        return True
    if here == NOTHING:
        return False
    return search(codes, leads, distance, end, signals) == NOTHING


@bare_kernel
def onward(codes: NDArray[np.int32], leads: NDArray[np.int32], distance: NDArray[np.int16], here: int) -> int:
    """The next configuration on a shortest way, NOTHING if there is none."""
    code = codes[here]
    if code & SINGLE:
        to = code >> AHEAD_SHIFT
        return int(to) if distance[to] != UNREACHED else NOTHING
    best, least = NOTHING, UNREACHED
    for turn in range(3, 6):
        way = (here + turn) & 3
        if code >> way & 1:
            to = leads[(here & ~3) + way]
            if distance[to] < least:
                best, least = int(to), distance[to]
    return best


@bare_kernel
def search(
    codes: NDArray[np.int32], leads: NDArray[np.int32], distance: NDArray[np.int16], end: int, signals: Signals
) -> int:
    """Go wherever nobody claims a cell: NOTHING once the target is there, else how many places of `queue` were seen."""
    queue, stamps, claims = signals.queue, signals.stamps, signals.claims
    signals.numbers[SEARCHES] += 1
    stamp = signals.numbers[SEARCHES]
    queue[0], stamps[end] = end, stamp
    looked, found = 0, 1
    while looked < found:
        here = queue[looked]
        looked += 1
        code = codes[here]
        for way in range(4):
            if code >> way & 1 and (code & SINGLE or way != (here + 2) & 3):
                to = leads[(here & ~3) + way]
                if stamps[to] == stamp or distance[to] == UNREACHED or claims[to >> 2] != 0:
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
    codes, leads = batch.codes[slot], batch.leads[slot]
    for at in range(batch.worlds[slot]["trains"]):
        if not signals.left[at] or is_hindered(signals, at):
            continue
        rest, length = signals.rests[at], signals.lengths[at]
        end = int(signals.routes[at, length - 1])
        vanish(signals, at)
        found = search(codes, leads, batch.distances[slot, at], end, signals)
        for number in range(1, found):
            signals.places[number] = signals.queue[number]
        signals.rests[at], signals.lengths[at] = length, length + 1
        proven = False
        for number in range(1, found):
            place = int(signals.places[number])
            if not may_rest(codes, place, signals):
                continue
            signals.routes[at, length] = place
            stand(signals, at)
            count = send_home(batch, slot, signals, home)
            proven = count - home == remain
            while count > home:
                count -= 1
                back = signals.home[count]
                signals.left[back] = True
                stand(signals, back)
            vanish(signals, at)
            if proven:
                break
        signals.rests[at], signals.lengths[at] = rest, length
        stand(signals, at)
        if proven:
            return True
    return False


@bare_kernel
def is_hindered(signals: Signals, at: int) -> bool:
    """Whether somebody else rests before a train on its route."""
    route = signals.routes[at]
    for place in range(signals.rests[at] + 1, signals.lengths[at]):
        if signals.resting[route[place] >> 2] != NOTHING:
            return True
    return False
