"""Levels of flatland-rl 4.3.0 as it is: its sparse rails and lines, and if wanted timetable, speeds, malfunctions.

For the `stock` rules: their levels have a schedule. The study's own levels are those of `common.levels.legacy`.
"""

import random
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs.line_generators import sparse_line_generator
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_generators import sparse_rail_generator
from flatland.envs.timetable_generators import timetable_generator
from flatland.envs.timetable_utils import Timetable

from common.levels.legacy import LEVEL_TRIES, SIDE_CELLS, InfeasibleLevelError, forget_rails
from common.levels.level import Level
from common.rail.from_flatland import level_of
from common.seeding import stream_key

SEED_BITS = (1 << 32) - 1  # what the library's generator takes


@dataclass(frozen=True)
class StockSpec:
    """What is drawn.

    Attributes:
        trains: how many.
        cities: at most so many.
        side: of the grid.
        rails_between_cities: at most.
        rail_pairs_in_city: at most.
        timetable: windows for departure and arrival, and a step limit after them; else every train may depart at
            once, and the limit is `8 * (h + w + trains / cities)` steps.
        speeds: shares of the trains by their speed in cells a step; all 1 if not given.
        malfunctions: rate, and the least and the most steps that one takes.
    """

    trains: int
    cities: int
    side: int = SIDE_CELLS
    rails_between_cities: int = 2
    rail_pairs_in_city: int = 2
    timetable: bool = True
    speeds: Mapping[float, float] | None = None
    malfunctions: tuple[float, int, int] | None = None


SPECS: dict[str, StockSpec] = {
    "easy": StockSpec(trains=3, cities=2),
    "medium": StockSpec(trains=5, cities=2),
    "hard": StockSpec(trains=7, cities=3),
}


def generate(spec: StockSpec, seed: int) -> Level:
    """The level of `seed`: a pure function, the same in every process, whatever the global generators hold.

    Raises:
        InfeasibleLevelError: none of `LEVEL_TRIES` derived seeds gave a level whose trains can all arrive.
    """
    for attempt in range(LEVEL_TRIES):
        derived = stream_key(seed, attempt, "stock-retry") & SEED_BITS if attempt else seed
        state = random.getstate()  # the library seeds the interpreter's own generator
        try:
            env = environment(spec, derived)
            env.reset(random_seed=derived)
            if _is_feasible(env, spec.trains):
                return level_of(env)
        finally:
            random.setstate(state)
            forget_rails()
    raise InfeasibleLevelError(f"no feasible level for seed {seed} in {LEVEL_TRIES} tries")


def environment(spec: StockSpec, seed: int) -> RailEnv:
    """The library's environment that draws such levels; it was not reset yet."""
    malfunctions = None if spec.malfunctions is None else ParamMalfunctionGen(MalfunctionParameters(*spec.malfunctions))
    return RailEnv(
        width=spec.side,
        height=spec.side,
        number_of_agents=spec.trains,
        rail_generator=sparse_rail_generator(
            max_num_cities=spec.cities,
            max_rails_between_cities=spec.rails_between_cities,
            max_rail_pairs_in_city=spec.rail_pairs_in_city,
        ),
        line_generator=sparse_line_generator(spec.speeds),  # type: ignore[arg-type]
        timetable_generator=timetable_generator if spec.timetable else _no_timetable,
        malfunction_generator=malfunctions,
        obs_builder_object=DummyObservationBuilder(),  # type: ignore[no-untyped-call]
        random_seed=seed,
    )


def _no_timetable(agents: Any, distance_map: Any, hints: Any, np_random: Any = None) -> Timetable:  # noqa: ARG001
    cities = len(hints["city_positions"])
    limit = int(8 * (distance_map.rail.height + distance_map.rail.width + len(agents) / cities))
    departures: list[Any] = [[0, None] for _ in agents]
    arrivals: list[Any] = [[None, limit] for _ in agents]
    return Timetable(departures, arrivals, limit)


def _is_feasible(env: RailEnv, trains: int) -> bool:
    agents: Any = env.agents
    distances: Any = env.distance_map.get()
    starts = [(agent.handle, *agent.initial_configuration[0], agent.initial_configuration[1]) for agent in agents]
    return len(starts) == trains and all(np.isfinite(distances[start]) for start in starts)
