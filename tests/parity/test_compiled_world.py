"""The compiled world equals the world on flatland-rl 4.3.0."""

import numpy as np
import pytest

from common.config import DIFFICULTIES, Difficulty
from common.levels.shipped import generate
from common.rail.compiled.world import CompiledWorld
from common.rail.flatland_world import FlatlandWorld

MIXES = ([0.2] * 5, [0.05, 0.1, 0.7, 0.1, 0.05], [0.0, 0.0, 1.0, 0.0, 0.0])
SLOTS = 2


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_it_equals_the_world_on_flatland(difficulty: Difficulty):
    compare_worlds(difficulty, seeds=range(3))


@pytest.mark.slow
@pytest.mark.parity
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_it_equals_the_world_on_flatland_over_many_levels(difficulty: Difficulty):
    compare_worlds(difficulty, seeds=range(100, 160))


def compare_worlds(difficulty: Difficulty, seeds: range) -> None:
    """Random play, step by step and to the bit; slots are loaded anew when their episode is over."""
    theirs, ours = FlatlandWorld(SLOTS, 7), CompiledWorld(SLOTS, 7)
    rng = np.random.default_rng(seeds.start)
    waiting = list(seeds)
    observed = 0
    while waiting or not theirs.over().all():
        for slot in np.flatnonzero(theirs.over()).tolist()[: len(waiting)]:
            level = generate(difficulty, waiting.pop())
            theirs.load(slot, level)
            ours.load(slot, level)
        deciding = theirs.deciding()
        np.testing.assert_array_equal(ours.deciding(), deciding)
        where, vectors = ours.observe_deciding()
        np.testing.assert_array_equal(where, np.argwhere(deciding))
        for (slot, train), vector in zip(where.tolist(), vectors, strict=True):
            assert vector.tobytes() == theirs.observe(slot, train).tobytes()
            observed += 1
        actions = rng.choice(5, p=MIXES[len(waiting) % len(MIXES)], size=(SLOTS, 7)).astype(np.int8)
        assert ours.step(actions).tobytes() == theirs.step(actions).tobytes()
        np.testing.assert_array_equal(ours.arrived(), theirs.arrived())
        np.testing.assert_array_equal(ours.over(), theirs.over())
        for slot, train in np.argwhere(theirs.over()[:, None] & ~theirs.arrived()).tolist():
            if train < theirs._episodes[slot].level.n_trains:  # what a train sees that the step limit stopped
                assert ours.observe(slot, train).tobytes() == theirs.observe(slot, train).tobytes()
    assert observed > 100
