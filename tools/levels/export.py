"""Writing levels as flatland-rl's own .pkl files, so that its tools can play them (under its rules of today).

Speeds, windows, malfunctions and the headings that count at targets go along. Without a schedule every train runs at 1,
may depart at once and has until the step limit.
"""

import random
from pathlib import Path

from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs.persistence import RailEnvPersister

from railctl.common.levels.level import Level
from railctl.common.rail.plain_env import plain_environment
from railctl.tools.levels.library import forget_rails


def save_pickle(path: Path, level: Level) -> None:
    """Write a level as a .pkl file; flatland's .mpk is broken in 4.3.0."""
    state = random.getstate()  # the library seeds the interpreter's own generator
    try:
        env = plain_environment(level, DummyObservationBuilder(), random_seed=0)  # type: ignore[no-untyped-call]
        env.reset()
        RailEnvPersister.save(env, path)
    finally:
        random.setstate(state)
        forget_rails()
