"""A flatland-rl 4.3.0 environment on a given level, made as its users make one; nothing is left out for speed."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from flatland.core.effects_generator import EffectsGenerator
from flatland.core.env_observation_builder import ObservationBuilder
from flatland.core.grid.grid4 import Grid4TransitionsEnum
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.envs.rail_trainrun_data_structures import Waypoint
from flatland.envs.step_utils.states import TrainState
from flatland.envs.timetable_utils import Line, Timetable

from railctl.common.levels.level import Level

ALL_HEADINGS = 15


class StartReady(EffectsGenerator[RailEnv]):
    """4.3.0 spends the first step on becoming ready to depart; 2.2.2 starts so."""

    def on_episode_start(self, env: RailEnv, *_args: Any, **_kwargs: Any) -> RailEnv:
        agents: list[Any] = env.agents
        for agent in agents:
            agent.state_machine.set_state(TrainState.READY_TO_DEPART)
        return env


def plain_environment(
    level: Level, observer: ObservationBuilder[Any, Any], speeds: Sequence[float] | None = None, **options: Any
) -> RailEnv:
    """The environment, before its first reset.

    Args:
        level: what is played, with its schedule.
        observer: gives the observations.
        speeds: of the trains, in cells a step; those of the level if not given.
        options: of `RailEnv`, which come before what the level says.
    """
    height, width = level.grid.shape
    malfunctions = None if level.schedule is None else level.schedule.malfunctions
    if malfunctions is not None and "malfunction_generator" not in options:
        options["malfunction_generator"] = ParamMalfunctionGen(MalfunctionParameters(*malfunctions))
    return RailEnv(
        width,
        height,
        rail_generator=lambda *_args: (RailGridTransitionMap(width, height, grid=level.grid.copy()), None),
        line_generator=lambda rail, *_args: line_of(level, rail, speeds),
        timetable_generator=lambda *_args: timetable_of(level),
        number_of_agents=level.n_trains,
        obs_builder_object=observer,
        **options,
    )


def line_of(level: Level, rail: RailGridTransitionMap, speeds: Sequence[float] | None = None) -> Line:
    """Where the trains start and go, and how fast they run: as the level says if not given."""
    waypoints = {}
    for train in range(level.n_trains):
        row, column, heading = level.starts[train].tolist()
        target = tuple(level.targets[train].tolist())
        wanted = 0 if level.schedule is None else int(level.schedule.target_headings[train])
        ends = [
            Waypoint(target, way)
            for way in Grid4TransitionsEnum
            if (wanted or ALL_HEADINGS) >> way & 1 and rail.is_valid_configuration((target, way))
        ]
        waypoints[train] = [[Waypoint((row, column), Grid4TransitionsEnum(heading))], ends]
    return Line(waypoints, speeds_of(level) if speeds is None else list(speeds))


def speeds_of(level: Level) -> list[Any]:
    """The speeds of the trains, in cells a step, as the library takes them."""
    if level.schedule is None:
        return [1.0] * level.n_trains
    return [Fraction(*speed) for speed in level.schedule.speeds.tolist()]


def timetable_of(level: Level) -> Timetable:
    """The level's windows; without a schedule every train may depart at once, and has until the step limit."""
    schedule, n_trains = level.schedule, level.n_trains
    earliest = [0] * n_trains if schedule is None else schedule.earliest_departures.tolist()
    latest = [level.max_steps] * n_trains if schedule is None else schedule.latest_arrivals.tolist()
    departures: list[Any] = [[step, None] for step in earliest]
    arrivals: list[Any] = [[None, step] for step in latest]
    return Timetable(departures, arrivals, level.max_steps)
