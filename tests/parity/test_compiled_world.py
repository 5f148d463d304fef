"""The compiled world replays episodes recorded with flatland-rl 2.2.2, and equals the world on flatland-rl 4.3.0."""

from pathlib import Path

import numpy as np
import pytest
from test_recorded_episodes import ARRIVED, EPISODES, recording

from common.config import DIFFICULTIES, Difficulty
from common.levels.legacy import generate
from common.levels.level import Level
from common.rail.compiled.arrays import NOWHERE
from common.rail.compiled.world import CompiledWorld
from common.rail.flatland_world import FlatlandWorld

MIXES = ([0.2] * 5, [0.05, 0.1, 0.7, 0.1, 0.05], [0.0, 0.0, 1.0, 0.0, 0.0])
SLOTS = 2


@pytest.mark.parametrize(("path", "name"), EPISODES)
def test_a_recorded_episode_replays(path: Path, name: str):
    told = {key.removeprefix(f"{name}_"): value for key, value in recording(path).items() if key.startswith(name)}
    agents = told["agents"].astype(np.int32)
    n_trains = len(agents)
    world = CompiledWorld(1, n_trains, decisions="legacy")
    world.load(0, Level(told["grid"], agents[:, :3], agents[:, 3:], int(told["max_steps"])))
    trains, cells = world.batch.trains[0], world.batch.cells[0]
    np.testing.assert_array_equal(world.trees()[0], told["trees"][0])
    for t, actions in enumerate(told["actions"]):
        assert not world.over()[0]
        rewards = world.obey(actions[None].astype(np.int8))[0]
        at = cells[trains["config"] >> 2]
        places = np.column_stack([at["row"], at["column"], trains["config"] & 3])
        places[trains["config"] == NOWHERE] = -1
        np.testing.assert_array_equal(places, told["positions"][t])
        np.testing.assert_array_equal(rewards, told["rewards"][t])
        np.testing.assert_array_equal(world.arrived()[0], told["status"][t] == ARRIVED)
        if not world.over()[0]:
            np.testing.assert_array_equal(world.deciding()[0], told["required"][t])
        if t + 1 < len(told["trees"]):
            np.testing.assert_array_equal(world.trees()[0], told["trees"][t + 1])
    assert world.over()[0] == bool(told["ended"])


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
