"""Writing levels as flatland-rl's own .pkl files, so that its tools can play them (under its rules of today).

Every train may depart at once and has until the step limit; speed 1, no malfunctions.
"""

import random
from pathlib import Path
from typing import Any

from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.core.grid.grid4 import Grid4TransitionsEnum
from flatland.envs.persistence import RailEnvPersister
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.envs.rail_trainrun_data_structures import Waypoint
from flatland.envs.timetable_utils import Line, Timetable

from common.levels.level import Level


def save_pickle(path: Path, level: Level) -> None:
    """Write a level as a .pkl file; flatland's .mpk is broken in 4.3.0."""
    state = random.getstate()  # the library seeds the interpreter's own generator
    try:
        env = _environment(level)
        env.reset()
    finally:
        random.setstate(state)
    RailEnvPersister.save(env, path)


def _environment(level: Level) -> RailEnv:
    height, width = level.grid.shape
    rail = RailGridTransitionMap(width, height, grid=level.grid.copy())
    return RailEnv(
        width,
        height,
        rail_generator=lambda *_args: (rail, None),
        line_generator=lambda *_args: _line(level, rail),
        timetable_generator=lambda *_args: _timetable(level),
        number_of_agents=level.n_trains,
        obs_builder_object=DummyObservationBuilder(),  # type: ignore[no-untyped-call]
        random_seed=0,
    )


def _line(level: Level, rail: RailGridTransitionMap) -> Line:
    waypoints = {}
    for train in range(level.n_trains):
        row, column, heading = level.starts[train].tolist()
        target = tuple(level.targets[train].tolist())
        ends = [Waypoint(target, way) for way in Grid4TransitionsEnum if rail.is_valid_configuration((target, way))]
        waypoints[train] = [[Waypoint((row, column), Grid4TransitionsEnum(heading))], ends]
    return Line(agent_waypoints=waypoints, agent_speeds=[1.0] * level.n_trains)


def _timetable(level: Level) -> Timetable:
    departures: list[Any] = [[0, None]] * level.n_trains
    arrivals: list[Any] = [[None, level.max_steps]] * level.n_trains
    return Timetable(departures, arrivals, level.max_steps)
