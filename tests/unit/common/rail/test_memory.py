"""Thousands of episodes in one process need no more memory than hundreds."""

import gc
import resource
from pathlib import Path

import numpy as np
import pytest

from railctl.common.levels.shipped import generate
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.player import Acting, compiled_world, network_layout, play
from railctl.common.policy.rollout import Rollouts
from railctl.common.rail.flatland_world import FlatlandWorld
from railctl.common.rules.settings import NetworkConfig
from railctl.common.world import study_world

EPISODES = 2000
WARM_UP_EPISODES = 200
STEPS = 30
COMPILED_EPISODES = 20_000
ALLOWED_GROWTH_MB = 30


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


@pytest.mark.slow
def test_memory_does_not_grow_with_episodes():
    world = FlatlandWorld(slots=1, max_trains=7)
    rng = np.random.default_rng(0)
    used_mb = []
    for seed in range(EPISODES):
        world.load(0, generate(("easy", "medium", "hard")[seed % 3], seed))
        for _ in range(STEPS):
            for _, train in np.argwhere(world.deciding()).tolist():
                world.observe(0, train)
            world.step(rng.integers(5, size=(1, 7)).astype(np.int8))
        if seed % WARM_UP_EPISODES == WARM_UP_EPISODES - 1:
            gc.collect()
            used_mb.append(resident_mb())
    assert max(used_mb) - used_mb[0] < ALLOWED_GROWTH_MB, used_mb


@pytest.mark.slow
def test_memory_does_not_grow_with_compiled_episodes():
    config = NetworkConfig(kind="dueling")
    twin, rollouts = Twin(network_layout(config, 252)), Rollouts(compiled_world(study_world(), "legacy", 7))
    twin.load(export_parameters(build_network(config, 252, 5, seed=1)))
    levels = [generate(("easy", "medium", "hard")[seed % 3], seed) for seed in range(30)]
    used_mb = []
    for number in range(COMPILED_EPISODES):
        play(rollouts, levels[number % len(levels)], Acting(twin, epsilon=0.5, key=number))
        if number % 1000 == 999:
            gc.collect()
            used_mb.append(resident_mb())
    assert max(used_mb) - used_mb[0] < ALLOWED_GROWTH_MB, used_mb
