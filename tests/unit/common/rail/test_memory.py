"""Thousands of episodes in one process need no more memory than hundreds."""

import gc
import resource
from pathlib import Path

import numpy as np
import pytest

from common.config import DIFFICULTIES
from common.levels.legacy import generate
from common.rail.flatland_world import FlatlandWorld

EPISODES = 2000
WARM_UP_EPISODES = 200
STEPS = 30
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
        world.load(0, generate(DIFFICULTIES[seed % 3], seed))
        for _ in range(STEPS):
            for _, train in np.argwhere(world.deciding()).tolist():
                world.observe(0, train)
            world.step(rng.integers(5, size=(1, 7)).astype(np.int8))
        if seed % WARM_UP_EPISODES == WARM_UP_EPISODES - 1:
            gc.collect()
            used_mb.append(resident_mb())
    assert max(used_mb) - used_mb[0] < ALLOWED_GROWTH_MB, used_mb
