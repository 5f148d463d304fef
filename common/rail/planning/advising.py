"""What a planner would do from any state that a world has got into: a teacher for those who act there.

"A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning", Ross et al. (AISTATS 2011)
asks an expert in the states that the learner itself comes to. Advice is a function of the state and of a key: trains
are planned anew every time, as nothing is remembered.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.streams import uniform
from railctl.common.rail.compiled.arrays import DONE, NOTHING, NOWHERE, UNREACHED, Batch
from railctl.common.rail.compiled.decisions import CELLS
from railctl.common.rail.compiled.step import leave
from railctl.common.rail.planning.plans import by_distance, distance_left, plan
from railctl.common.rail.planning.rails import action_out, any_way
from railctl.common.rail.planning.search import ANYTHING, Room, pace, ready, room_for
from railctl.common.rail.world import MOVE_FORWARD, STOP_MOVING

NONE: Final = -1  # no advice
NO_PLAN: Final = -2
PATIENCE: Final = 4  # plans end after so many times what the slowest train would take if it were alone


class Desk(NamedTuple):
    """What planning takes in any world of a batch.

    Attributes:
        room: see there.
        ways: [N, T + 1], of one plan.
        arrivals: [N], by it.
        order: [N], in which trains are planned.
        next: [N], the configuration that the best plan has a train go to next, or stay in if it may; NOWHERE off the
            map; NO_PLAN for trains that find no way.
    """

    room: Room
    ways: NDArray[np.int32]
    arrivals: NDArray[np.int32]
    order: NDArray[np.int64]
    next: NDArray[np.int32]


def desk_for(batch: Batch, steps: int, before: Desk | None = None) -> Desk:
    """A desk for worlds of a batch with at most so many steps: the one before, if that is large enough.

    Raises:
        ValueError: see `room_for`.
    """
    cells, trains = batch.cells.shape[1], batch.trains.shape[1]
    if before is not None:
        times, room_cells = before.room.held.shape
        if times > steps and room_cells >= cells and len(before.order) >= trains:
            return before
        steps, cells, trains = max(steps, times - 1), max(cells, room_cells), max(trains, len(before.order))
    return new_desk(steps, cells, trains)


def new_desk(steps: int, cells: int, trains: int) -> Desk:
    """A desk for worlds of so many steps, cells and trains; raises ValueError as `room_for` does."""
    return Desk(
        room=room_for(steps, cells),
        ways=np.empty((trains, steps + 1), np.int32),
        arrivals=np.empty(trains, np.int32),
        order=np.empty(trains, np.int64),
        next=np.empty(trains, np.int32),
    )


@bare_kernel
def horizon(batch: Batch, slot: int) -> int:
    """The steps that are planned ahead: those that are left, or fewer if all trains need far fewer."""
    world, longest = batch.worlds[slot], 1
    for at in range(world["trains"]):
        left = distance_left(batch, slot, at)
        if batch.trains[slot, at]["state"] != DONE and left != UNREACHED:
            longest = max(longest, ready(batch, slot, at) + 1 + left * pace(batch, slot, at))
    return min(int(world["max_steps"] - world["time"]), PATIENCE * longest)


@bare_kernel
def by_lot(order: NDArray[np.int64], key: np.uint64, first: int) -> None:
    """Sort trains by their draws of a stream, from some counter on.

    Who has arrived changes nothing for the others, so that the order of a plan is there again when its first steps have
    come true.
    """
    for last in range(1, len(order)):
        place, train = last, order[last]
        lot = uniform(key, np.uint64(first + train))
        while place > 0 and uniform(key, np.uint64(first + order[place - 1])) > lot:
            order[place] = order[place - 1]
            place -= 1
        order[place] = train


@bare_kernel
def note(batch: Batch, slot: int, planned: NDArray[np.int64], steps: int, desk: Desk) -> None:
    """Keep what a plan has its trains do next."""
    for at in planned:
        way, first = desk.ways[at], min(steps, ready(batch, slot, at) + 1)
        if first > 1:  # it has to go on now, so whether it waits later is open
            while first < steps and way[first] == way[0]:
                first += 1
        desk.next[at] = way[first] if desk.arrivals[at] != NOTHING else NO_PLAN


@bare_kernel
def action_of(batch: Batch, slot: int, at: int, there: int) -> int:
    """What takes a train to its next configuration."""
    codes, here = batch.codes[slot], int(batch.trains[slot, at]["config"])
    if there == NO_PLAN:
        return NONE
    if there == here:
        return STOP_MOVING
    if here != NOWHERE:
        return action_out(codes, here, there & 3)
    start = int(batch.trains[slot, at]["start"])
    straight = leave(codes, batch.leads[slot], start, MOVE_FORWARD) != NOTHING
    return MOVE_FORWARD if straight else action_out(codes, start, any_way(codes, start))


@bare_kernel
def advise(
    batch: Batch,
    slot: int,
    deciding: NDArray[np.bool_],
    mode: int,
    orders: int,
    key: np.uint64,
    desk: Desk,
    labels: NDArray[np.int8],
) -> None:
    """The actions by which trains follow the best of several plans from now on.

    Args:
        batch: the world, as it is.
        slot: in which it is.
        deciding: [N], who asks.
        mode: of decisions, which says where trains can wait; see `common.rail.compiled.decisions`.
        orders: of trains that are tried: by distance, then as draws of the key say, the same in all steps.
        key: of the episode's stream.
        desk: to work on.
        labels: [at least N], filled in: STOP_MOVING to wait; NONE for those who did not ask, or find no way.
    """
    trains, count = int(batch.worlds[slot]["trains"]), by_distance(batch, slot, desk.order)
    planned, steps, least = desk.order[:count], horizon(batch, slot), 1 << 60
    for number in range(orders):
        if number:
            by_lot(planned, key, number * trains)
        spent = plan(
            batch, slot, planned, desk.room, steps, mode != CELLS, desk.ways, desk.arrivals, NOTHING, ANYTHING, least
        )
        if spent < least:
            least = spent
            note(batch, slot, planned, steps, desk)
    for at in range(trains):
        labels[at] = action_of(batch, slot, at, int(desk.next[at])) if deciding[at] else NONE
