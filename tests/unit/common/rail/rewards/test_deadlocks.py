"""Deadlocks against their definition, and against what trains in them can do."""

from itertools import chain, combinations, permutations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.levels.distributions import shipped
from railctl.common.levels.legacy import generate
from railctl.common.rail.compiled.arrays import DONE
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.rewards.deadlocks import FREE, find_deadlocks, hold

NO_WAY = -1
MOST = 5


def holds(members: tuple[int, ...], ahead: np.ndarray) -> bool:
    """Whether a set of trains is closed, and no three or more of it can turn in a ring."""
    if any(other != NO_WAY and other not in members for at in members for other in ahead[at]):
        return False
    rings = chain.from_iterable(permutations(members, length) for length in range(3, len(members) + 1))
    return not any(all(ring[(at + 1) % len(ring)] in ahead[ring[at]] for at in range(len(ring))) for ring in rings)


@settings(deadline=None)
@given(st.integers(1, MOST), st.integers(0, 2**32), st.floats(0, 0.3), st.floats(0, 0.7))
def test_they_are_the_largest_set_of_the_definition(count: int, seed: int, free: float, no_way: float):
    rng = np.random.default_rng(seed)
    ahead = rng.integers(count, size=(count, 3)).astype(np.int32)
    ahead[rng.random(ahead.shape) < no_way] = NO_WAY
    ahead[rng.random(ahead.shape) < free] = FREE
    ahead[ahead == np.arange(count)[:, None]] = NO_WAY  # nobody is ahead of itself
    sets = chain.from_iterable(combinations(range(count), size) for size in range(count + 1))
    largest = max((members for members in sets if holds(members, ahead)), key=len)
    stuck = np.ones(count, np.bool_)
    assert hold(ahead, stuck, count) == len(largest)
    assert tuple(np.flatnonzero(stuck).tolist()) == largest


def test_a_train_in_a_deadlock_never_moves_again():
    found = 0
    for seed in range(6):
        world, rng = CompiledWorld(1, 7, rules="stock", decisions="always"), np.random.default_rng(seed)
        world.load(0, generate(shipped()["hard"], seed))
        trains, places = world.batch.trains[0], {}
        stuck = np.zeros(7, np.bool_)
        while not world.over()[0]:
            world.obey(rng.choice(5, p=[0.05, 0.15, 0.6, 0.15, 0.05], size=(1, 7)).astype(np.int8))
            count = find_deadlocks(world.batch, 0, stuck)
            assert count == stuck.sum()
            for train in np.flatnonzero(stuck).tolist():
                assert trains[train]["state"] != DONE
                assert places.setdefault(train, trains[train]["config"]) == trains[train]["config"]
            assert stuck[list(places)].all()  # who was in one still is
        found += len(places)
    assert found > 5
