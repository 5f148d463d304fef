"""What a train should best do, told by what becomes of all of them: a teacher for those who decide one after another.

As in `common.rail.planning.advising` trains are planned from where they are, but for each action anew that a train is
allowed. A plan in which everybody goes as early as can be is one of many that are as good; to follow just this one
teaches habits of the planner. So the teacher has a train take its shortest way, unless something else gets all of them
home sooner, by some margin, in all.
"""

from typing import Final, NamedTuple

import numpy as np

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import NOWHERE, Batch
from railctl.common.rail.compiled.decisions import CELLS
from railctl.common.rail.compiled.step import destination
from railctl.common.rail.interlocking.asking import valid
from railctl.common.rail.planning.advising import NONE, Desk, by_lot, horizon
from railctl.common.rail.planning.plans import by_distance, plan
from railctl.common.rail.planning.rails import shortest_allowed
from railctl.common.rail.world import MOVE_LEFT, STOP_MOVING

ENDLESS: Final = 1 << 60


class Teacher(NamedTuple):
    """Whom to ask, in an episode.

    Attributes:
        orders: of trains that are tried for every action; the best plan counts.
        margin: steps by which something else must be better than the shortest way, summed over all trains.
        patience: steps after which a train that stands has to take the shortest way that it is allowed.
        key: of the stream of what is drawn.
    """

    orders: int
    margin: int
    patience: int
    key: np.uint64


@bare_kernel
def judge(batch: Batch, slot: int, at: int, allowed: int, decisions: int, teacher: Teacher, desk: Desk) -> int:
    """What a train should do that decides; NONE if it has no choice.

    Args:
        batch: the world, as it is; nobody has moved yet in this step.
        slot: in which it is.
        at: the train.
        allowed: the actions that it may take, a bit each.
        decisions: the rule that says where trains can wait; see `common.rail.compiled.decisions`.
        teacher: whom to ask.
        desk: to work on.
    """
    train = batch.trains[slot, at]
    bits = allowed & valid(batch.codes[slot], train)
    if bits & (bits - 1) == 0:
        return NONE
    shortest = shortest_allowed(batch, slot, at, bits)
    is_late = train["config"] != NOWHERE and train["stood"] >= teacher.patience
    if shortest == STOP_MOVING or is_late:
        return shortest
    best, first = shortest, spent(batch, slot, at, shortest, decisions, teacher, desk)
    fewest = first - teacher.margin + 1  # what the next has to be below
    for action in range(MOVE_LEFT, STOP_MOVING + 1):
        if action != shortest and bits >> action & 1:
            steps = spent(batch, slot, at, action, decisions, teacher, desk)
            if steps < fewest:
                best, fewest = action, steps
    return best


@bare_kernel
def spent(batch: Batch, slot: int, at: int, action: int, decisions: int, teacher: Teacher, desk: Desk) -> int:
    """The steps that all trains take by the best plan in which a train takes an action first."""
    trains, steps, least = int(batch.worlds[slot]["trains"]), horizon(batch, slot), ENDLESS
    train = batch.trains[slot, at]
    to = destination(batch.codes[slot], batch.leads[slot], train, action)
    first = int(train["config"]) if action == STOP_MOVING else to
    planned = desk.order[: by_distance(batch, slot, desk.order)]
    for number in range(teacher.orders):
        if number:
            by_lot(planned, teacher.key, number * trains)
        anywhere = decisions != CELLS
        least = plan(batch, slot, planned, desk.room, steps, anywhere, desk.ways, desk.arrivals, at, first, least)
    return least
