"""A flatland-rl 4.3.0 environment as a `Level`, for the compiled world.

What the compiled world does not know is refused by name: level-free crossings, trains that stay at their targets,
accelerations other than 1 and -1, effects other than the library's plain malfunctions.
"""

from typing import Any

import numpy as np
from flatland.envs.malfunction_effects_generators import MalfunctionEffectsGenerator
from flatland.envs.rail_env import RailEnv

from railctl.common.levels.level import Level, Malfunctions, Schedule


class UnsupportedEnvironmentError(ValueError):
    """The environment does something that the compiled world does not."""


def level_of(env: RailEnv, *, with_schedule: bool = True) -> Level:
    """The level that `env` was reset to; nothing is drawn from its generator.

    Args:
        env: at its first step.
        with_schedule: also how trains run; else effects of any kind will do.

    Raises:
        UnsupportedEnvironmentError: see the module.
    """
    world: Any = env
    agents, free = world.agents, world.resource_map.level_free_positions
    if free:
        raise UnsupportedEnvironmentError(f"level-free crossings at {sorted(free)}")
    if not env.remove_agents_at_target:
        raise UnsupportedEnvironmentError("trains stay on the map at their targets (remove_agents_at_target=False)")
    if (world.acceleration_delta, world.braking_delta) != (1, -1):
        raise UnsupportedEnvironmentError(
            f"acceleration {env.acceleration_delta} and braking {env.braking_delta} instead of 1 and -1"
        )
    starts = [(*agent.initial_configuration[0], int(agent.initial_configuration[1])) for agent in agents]
    targets = [{position for position, _ in agent.targets} for agent in agents]
    if any(len(cells) != 1 for cells in targets):
        raise UnsupportedEnvironmentError("a train has targets in several cells")
    max_steps = world._max_episode_steps  # noqa: SLF001  (there is no other way to ask)
    if max_steps is None:
        raise UnsupportedEnvironmentError("there is no step limit")
    return Level(
        grid=np.array(world.rail.grid, np.uint16),
        starts=np.array(starts, np.int32),
        targets=np.array([next(iter(cells)) for cells in targets], np.int32),
        max_steps=int(max_steps),
        schedule=schedule_of(env, _malfunctions_of(env)) if with_schedule else None,
    )


def schedule_of(env: RailEnv, malfunctions: Malfunctions | None) -> Schedule:
    """How the trains of an environment run, with these malfunctions."""
    agents: Any = env.agents
    speeds = [agent.speed_counter.max_speed for agent in agents]
    headings = [{int(heading) for _, heading in agent.targets} for agent in agents]
    return Schedule(
        speeds=np.array([(speed.numerator, speed.denominator) for speed in speeds], np.int32),
        earliest_departures=np.array([agent.earliest_departure for agent in agents], np.int32),
        latest_arrivals=np.array([agent.latest_arrival for agent in agents], np.int32),
        target_headings=np.array([sum(1 << heading for heading in some) for some in headings], np.int32),
        malfunctions=malfunctions,
    )


def _malfunctions_of(env: RailEnv) -> Malfunctions | None:
    world: Any = env
    effects = world.effects_generator
    if type(effects) is not MalfunctionEffectsGenerator:
        raise UnsupportedEnvironmentError(f"effects of {type(effects).__name__}")
    rate, shortest, longest = effects.malfunction_generator.get_process_data()
    return Malfunctions(rate, shortest, longest) if rate > 0 else None
