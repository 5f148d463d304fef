"""Environments of flatland-rl as levels; what the compiled world does not know is refused."""

from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest

from railctl.common.levels.shipped import generate
from railctl.common.rail.flatland_env import LevelEnv
from railctl.common.rail.from_flatland import UnsupportedEnvironmentError, level_of
from railctl.tools.bench.world import MALFUNCTIONS, environment

LEVEL = generate("medium", 1)


def reset_env(*, disturbed: bool) -> Any:
    env: Any = environment(LEVEL, disturbed=disturbed)
    env.reset(random_seed=3)
    return env


def test_a_level_comes_back():
    level = level_of(reset_env(disturbed=False))
    assert replace(level, schedule=None).content_hash == LEVEL.content_hash
    assert level.schedule.speeds.tolist() == [[1, 1]] * 5
    assert level.schedule.malfunctions is None


def test_speeds_and_malfunctions_come_along_and_nothing_is_drawn():
    env = reset_env(disturbed=True)
    before = env.np_random.get_state()[2]
    schedule = level_of(env).schedule
    assert schedule.speeds.tolist() == [[1, 1], [1, 2], [1, 3], [1, 4], [1, 1]]
    assert schedule.malfunctions == MALFUNCTIONS
    assert env.np_random.get_state()[2] == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda env: env.resource_map.level_free_positions.add((3, 4)), "level-free crossings at"),
        (lambda env: setattr(env, "remove_agents_at_target", False), "stay on the map"),
        (lambda env: setattr(env, "acceleration_delta", Fraction(1, 2)), "acceleration 1/2"),
        (lambda env: setattr(env, "_max_episode_steps", None), "no step limit"),
        (lambda env: env.agents[0].targets.add(((0, 0), 0)), "several cells"),
    ],
)
def test_what_is_not_known_is_refused(change: Any, message: str):
    env = reset_env(disturbed=False)
    change(env)
    with pytest.raises(UnsupportedEnvironmentError, match=message):
        level_of(env)


def test_other_effects_are_refused():
    env = LevelEnv(LEVEL)
    with pytest.raises(UnsupportedEnvironmentError, match="effects of _StartReady"):
        level_of(env)
