"""Levels of flatland-rl 4.3.0 of any size, as the library's own environment draws them."""

import random
from typing import Any

from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs.line_generators import sparse_line_generator
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_generators import sparse_rail_generator
from flatland.envs.timetable_generators import timetable_generator
from flatland_oracle import forget, no_timetable

from railctl.common.levels.level import Level
from railctl.common.rail.from_flatland import level_of

MIXED = {1.0: 0.4, 0.5: 0.3, 0.33: 0.3}


def stock_level(
    seed: int,
    side: int,
    trains: int,
    cities: int,
    *,
    speeds: dict[float, float] | None = None,
    malfunctions: tuple[float, int, int] | None = None,
    timetable: bool = True,
    rail_pairs: int = 2,
) -> Level:
    """The level of a seed."""
    state = random.getstate()
    env: Any = RailEnv(
        side,
        side,
        rail_generator=sparse_rail_generator(
            max_num_cities=cities, max_rails_between_cities=2, max_rail_pairs_in_city=rail_pairs
        ),
        line_generator=sparse_line_generator(speeds),
        number_of_agents=trains,
        obs_builder_object=DummyObservationBuilder(),
        timetable_generator=timetable_generator if timetable else no_timetable,
        malfunction_generator=ParamMalfunctionGen(MalfunctionParameters(*malfunctions)) if malfunctions else None,
        random_seed=seed,
    )
    env.reset(random_seed=seed)
    random.setstate(state)
    level = level_of(env)
    forget()
    assert level.n_trains == trains
    return level
