"""The numbers of the traffic observation, part by part; what they mean: `common.rail.observations.traffic`."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import BROKEN, DONE, NOTHING, NOWHERE, STOPPED, UNREACHED, Batch
from railctl.common.rail.compiled.conflicts import NEVER, compare, nearness, scaled
from railctl.common.rail.compiled.decisions import decides_there
from railctl.common.rail.compiled.step import destination
from railctl.common.rail.compiled.tree import Sight
from railctl.common.rail.compiled.ways import trace
from railctl.common.rail.interlocking.asking import allowed, valid
from railctl.common.rail.observations.traffic_shape import N_EXITS, N_MEETING, N_OTHER
from railctl.common.rail.world import MOVE_LEFT

JOURNEY_CELLS: Final = 100.0
DETOUR_CELLS: Final = 25.0
STOP_CELLS: Final = 20.0
PATIENCE_STEPS: Final = 20.0
MALFUNCTION_STEPS: Final = 20.0
SOON_STEPS: Final = 50.0
MANY_TRAINS: Final = 10.0
FEW_TRAINS: Final = 5.0


@bare_kernel
def standpoint(train: np.void) -> int:
    """The configuration where a train is, or from which it departs."""
    return int(train["start"] if train["config"] == NOWHERE else train["config"])


@bare_kernel
def stands(train: np.void) -> bool:
    """Whether a train is on the map and does not move."""
    return bool(train["state"] == STOPPED or train["state"] == BROKEN)


@bare_kernel
def describe_train(batch: Batch, slot: int, at: int, sight: Sight, numbers: NDArray[np.float32]) -> None:
    """Fill in the numbers [13] of a train that has not arrived."""
    world, trains, ways = batch.worlds[slot], batch.trains[slot], sight.ways
    train, limit = trains[at], int(world["max_steps"])
    here = standpoint(train)
    distance = int(batch.distances[slot, at, here])
    on_map, left, shorter, through = 0, 0, 0, 0
    for other in range(world["trains"]):
        if trains[other]["state"] == DONE:
            continue
        left += 1
        on_map += trains[other]["config"] != NOWHERE
        if other != at:
            shorter += batch.distances[slot, other, standpoint(trains[other])] < distance
            through += train["config"] != NOWHERE and ways.places[other, here >> 2] != NOTHING
    needed = ways.paces[at, 0] + (distance - (train["config"] != NOWHERE)) * ways.paces[at, 1]
    time = int(world["time"])
    numbers[0] = train["config"] != NOWHERE
    numbers[1] = scaled(distance, JOURNEY_CELLS)
    numbers[2] = scaled(time, limit)
    numbers[3] = scaled(on_map, MANY_TRAINS)
    numbers[4] = scaled(left, MANY_TRAINS)
    numbers[5] = shorter / max(1, left - 1)
    numbers[6] = scaled(limit - time - needed, limit)
    numbers[7] = scaled(int(train["latest_arrival"]) - time - needed, limit)
    numbers[8] = scaled(through, MANY_TRAINS)
    numbers[9] = scaled(int(train["stood"]), PATIENCE_STEPS)
    numbers[10] = stands(train)
    numbers[11] = scaled(int(train["malfunction"]), MALFUNCTION_STEPS)
    numbers[12] = train["full_speed"] / world["unit"]


@bare_kernel
def describe_exits(
    batch: Batch, slot: int, at: int, sight: Sight, decisions: int, mode: int, numbers: NDArray[np.float32]
) -> None:
    """Fill in the numbers [3, 16] of a train's exits, but for the last two; and `sight.meetings` and `sight.soon`."""
    codes, leads, distances = batch.codes[slot], batch.leads[slot], batch.distances[slot, at]
    trains, ways, train = batch.trains[slot], sight.ways, batch.trains[slot, at]
    here, count = int(train["config"]), int(batch.worlds[slot]["trains"])
    there, granted = valid(codes, train), allowed(batch, slot, mode, at, sight.signals)
    mine = len(ways.lengths) - 1
    ways.paces[mine, 0], ways.paces[mine, 1] = ways.paces[at, 0], ways.paces[at, 1]
    sight.meetings.reshape(sight.meetings.size)[:] = 0
    sight.soon.reshape(sight.soon.size)[:] = NEVER
    for way in range(N_EXITS):
        if not there >> (MOVE_LEFT + way) & 1:
            continue
        to = destination(codes, leads, train, MOVE_LEFT + way)
        trace(codes, leads, distances, ways, mine, here, to)
        numbers[way, 0] = 1
        numbers[way, 1] = granted >> (MOVE_LEFT + way) & 1
        measure(distances, here, to, numbers[way])
        occupant = batch.cells[slot, to >> 2]["train"]
        numbers[way, 6] = occupant >= 0 and occupant != at
        follow(batch, slot, at, sight, decisions, numbers[way])
        for other in range(count):
            if other != at and trains[other]["state"] != DONE:
                soon = compare(ways, mine, other, sight.meetings[other, way])
                sight.soon[other, way] = soon
                sight.soon[other, N_EXITS] = min(sight.soon[other, N_EXITS], soon)


@bare_kernel
def measure(distances: NDArray[np.int16], here: int, to: int, numbers: NDArray[np.float32]) -> None:
    """Fill in how far an exit of `here` to `to` is from the target."""
    distance = int(distances[to])
    if distance == UNREACHED:
        numbers[3] = 1
        numbers[4] = 1
        return
    detour = 0 if here == NOWHERE else distance + 1 - int(distances[here])
    numbers[2] = 1
    numbers[3] = scaled(distance, JOURNEY_CELLS)
    numbers[4] = scaled(detour, DETOUR_CELLS)
    numbers[5] = detour == 0
    numbers[7] = distance == 0


@bare_kernel
def follow(batch: Batch, slot: int, at: int, sight: Sight, decisions: int, numbers: NDArray[np.float32]) -> None:
    """Fill in what there is on the way behind an exit."""
    codes, cells, trains = batch.codes[slot], batch.cells[slot], batch.trains[slot]
    path, length = sight.ways.paths[len(sight.ways.lengths) - 1], int(sight.ways.lengths[len(sight.ways.lengths) - 1])
    stop = 1
    while stop + 1 < length and not decides_there(codes, int(path[stop]), decisions):
        stop += 1
    numbers[8] = scaled(stop, STOP_CELLS)
    numbers[9] = batch.distances[slot, at, path[stop]] == 0
    first = oncoming = NOTHING
    many = longest = 0
    for place in range(1, length):
        other = int(cells[path[place] >> 2]["train"])
        if other < 0 or other == at:
            continue
        if first == NOTHING:
            first = place
        longest = max(longest, int(trains[other]["malfunction"]))
        if (trains[other]["config"] ^ path[place]) & 3 != 0:
            many += 1
            if oncoming == NOTHING:
                oncoming = place
    if first != NOTHING:
        numbers[10] = nearness(first)
    if oncoming != NOTHING:
        numbers[11] = nearness(oncoming)
    numbers[12] = scaled(many, FEW_TRAINS)
    numbers[13] = scaled(longest, MALFUNCTION_STEPS)


@bare_kernel
def describe_others(
    batch: Batch, slot: int, at: int, sight: Sight, exits: NDArray[np.float32], rows: NDArray[np.float32]
) -> None:
    """Fill in the rows [`others`, 55] of the most urgent other trains, and in the exits' numbers the rest."""
    trains, soon, apart = batch.trains[slot], sight.soon, sight.apart
    cells, count = batch.cells[slot], int(batch.worlds[slot]["trains"])
    here = cells[standpoint(trains[at]) >> 2]
    for other in range(count):
        if other == at or trains[other]["state"] == DONE:
            apart[other] = NOTHING  # has a row, or needs none
            continue
        there = cells[standpoint(trains[other]) >> 2]
        apart[other] = abs(int(here["row"]) - int(there["row"])) + abs(int(here["column"]) - int(there["column"]))
    for row in range(len(rows)):
        chosen = NOTHING
        for other in range(count):
            if apart[other] != NOTHING and (chosen == NOTHING or is_before(soon, apart, other, chosen)):
                chosen = other
        if chosen == NOTHING:
            break
        describe_other(batch, slot, at, chosen, sight, rows[row])
        apart[chosen] = NOTHING
    for way in range(N_EXITS):
        many, first = 0, NEVER
        for other in range(count):
            if apart[other] != NOTHING and soon[other, way] < NEVER:
                many += 1
                first = min(first, soon[other, way])
        exits[way, 14] = scaled(many, FEW_TRAINS)
        exits[way, 15] = max(0.0, 1.0 - first / SOON_STEPS)


@bare_kernel
def is_before(soon: NDArray[np.float64], apart: NDArray[np.int32], one: int, two: int) -> bool:
    """Whether one train is more urgent than another."""
    if soon[one, N_EXITS] != soon[two, N_EXITS]:
        return bool(soon[one, N_EXITS] < soon[two, N_EXITS])
    return bool(apart[one] < apart[two])


@bare_kernel
def describe_other(batch: Batch, slot: int, at: int, other: int, sight: Sight, numbers: NDArray[np.float32]) -> None:
    """Fill in the row [55] of another train."""
    train, ways, here = batch.trains[slot, other], sight.ways, standpoint(batch.trains[slot, at])
    numbers[0] = 1
    numbers[1] = train["config"] != NOWHERE
    numbers[2] = stands(train)
    numbers[3] = other < at
    numbers[4] = scaled(int(batch.distances[slot, other, standpoint(train)]), JOURNEY_CELLS)
    numbers[5] = scaled(int(train["malfunction"]), MALFUNCTION_STEPS)
    numbers[6] = train["full_speed"] / batch.worlds[slot]["unit"]
    numbers[7] = scaled(int(train["stood"]), PATIENCE_STEPS)
    numbers[8] = nearness(int(sight.apart[other]))
    place = int(ways.places[other, here >> 2])
    if place != NOTHING:
        numbers[9] = nearness(place)
    meetings = sight.meetings[other].reshape(N_EXITS * N_MEETING)
    for at_number in range(len(meetings)):
        numbers[N_OTHER + at_number] = meetings[at_number]
