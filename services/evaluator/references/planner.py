"""Planning in several orders of the trains, of which the best plan is carried out."""

import numpy as np
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from common.rail.compiled.arrays import WAITING
from common.rail.compiled.world import Parts
from common.seeding import stream_key
from services.evaluator.references.performing import Act
from services.evaluator.references.planning import FREE, actions_of, plan, search_room


def planner(parts: Parts, seed: int, index: int, orders: int) -> Act:
    """The best of plans in so many orders: the nearest to its target first, others by the draws of (seed, index)."""
    ways = best_ways(parts, seed, index, orders)
    trains = parts.batch.trains[0, : len(ways)]
    actions = actions_of(parts.batch.codes[0], trains["start"].copy(), ways)
    return lambda step: actions[step]


def best_ways(parts: Parts, seed: int, index: int, orders: int) -> NDArray[np.int32]:
    """[N, T + 1]: where trains of a freshly loaded world are after so many steps, NOWHERE off the map."""
    world, trains = parts.batch.worlds[0], parts.batch.trains[0]
    n_trains, steps, cells = int(world["trains"]), int(world["max_steps"]), int(world["cells"])
    distances = parts.batch.distances[0, np.arange(n_trains), trains["start"][:n_trains]]
    draws = Generator(Philox(key=stream_key(seed, index, "planner-orders")))
    earliest = int(trains[0]["state"] == WAITING)
    search, held = search_room(steps, cells), np.full((steps + 1, cells), FREE, np.int16)
    ways, best = np.empty((2, n_trains, steps + 1), np.int32)
    order, least = np.argsort(distances, kind="stable"), np.iinfo(np.int64).max
    for attempt in range(orders):
        spent = plan(parts.batch, order, earliest, search, 1 + attempt * n_trains, held, ways, least)
        if spent < least:
            ways, best, least = best, ways, spent
        order = draws.permutation(n_trains)
    return best
