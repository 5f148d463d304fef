"""Planning in several orders of the trains, of which the best plan is carried out.

Prioritised planning finds a plan for an order, not the best one there is: whoever comes first goes as if it were alone.
"""

import numpy as np
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from railctl.common.rail.compiled.arrays import NOTHING
from railctl.common.rail.compiled.world import Parts
from railctl.common.rail.planning.plans import actions_for, plan
from railctl.common.rail.planning.search import ANYTHING, room_for
from railctl.common.seeding import stream_key
from railctl.services.evaluator.references.performing import Act


def planner(seed: int, orders: int, index: int, parts: Parts) -> Act:
    """What the trains of a freshly loaded world do after the best of so many plans.

    Raises:
        ValueError: a plan would not come true.
    """
    actions = actions_of_best_plan(seed, orders, index, parts)
    return lambda step: actions[step]


def actions_of_best_plan(
    seed: int, orders: int, index: int, parts: Parts, *, anywhere: bool = True
) -> NDArray[np.int8]:
    """[T, N]: what makes the best of so many plans come true; `anywhere`: trains may wait where they do not decide.

    Raises:
        ValueError: a plan would not come true.
    """
    world = parts.batch.worlds[0]
    trains = parts.batch.trains[0, : world["trains"]]
    if world["breaks"] or (trains["full_speed"] != world["unit"]).any():
        raise ValueError("the planner plans for trains of speed 1 that never break down: choose another policy")
    ways = best_ways(seed, orders, index, parts, anywhere=anywhere)
    starts = parts.batch.trains[0, : len(ways)]["start"].copy()
    return actions_for(parts.batch.codes[0], starts, ways)


def best_ways(seed: int, orders: int, index: int, parts: Parts, *, anywhere: bool = True) -> NDArray[np.int32]:
    """[N, T + 1]: where trains are after so many steps, NOWHERE off the map.

    The first order is by distance, the nearest to its target first; the others are draws of (seed, index).
    """
    world = parts.batch.worlds[0]
    trains = parts.batch.trains[0, : world["trains"]]
    steps = int(world["max_steps"])
    draws = Generator(Philox(key=stream_key(seed, index, "planner-orders")))
    room = room_for(steps, int(world["cells"]))
    order = np.argsort(parts.batch.distances[0, np.arange(len(trains)), trains["start"]], kind="stable")
    ways = np.empty((len(trains), steps + 1), np.int32)
    arrivals = np.empty(len(trains), np.int32)
    best = np.empty_like(ways)
    least = np.iinfo(np.int64).max
    for _ in range(orders):
        spent = plan(parts.batch, 0, order, room, steps, anywhere, ways, arrivals, NOTHING, ANYTHING, least)
        if spent < least:
            best, ways, least = ways, best, spent
        order = draws.permutation(len(trains))
    return best
