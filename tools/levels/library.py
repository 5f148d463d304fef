"""flatland-rl's own environments that draw stock levels, made as its users make them: what ours are compared with."""

from collections.abc import Callable
from typing import Any

from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs.line_generators import sparse_line_generator
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_generators import sparse_rail_generator
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.envs.timetable_generators import timetable_generator
from flatland.envs.timetable_utils import Timetable

from railctl.common.levels.distributions import StockLevels
from railctl.common.levels.stock import shares_of


def library_environment(levels: StockLevels, seed: int) -> RailEnv:
    """The environment that draws such levels; it was not reset yet."""
    breakdowns = levels.malfunctions
    parameters = None if breakdowns is None else MalfunctionParameters(*breakdowns.model_dump().values())
    return RailEnv(
        width=levels.size[1],
        height=levels.size[0],
        number_of_agents=levels.trains,
        rail_generator=sparse_rail_generator(
            max_num_cities=levels.cities,
            max_rails_between_cities=levels.rails_between_cities,
            max_rail_pairs_in_city=levels.rail_pairs_in_city,
        ),
        line_generator=sparse_line_generator(shares_of(levels)),  # type: ignore[arg-type]
        timetable_generator=timetable_generator if levels.timetable else _no_timetable,
        malfunction_generator=None if parameters is None else ParamMalfunctionGen(parameters),
        obs_builder_object=DummyObservationBuilder(),  # type: ignore[no-untyped-call]
        random_seed=seed,
    )


def _no_timetable(agents: Any, distance_map: Any, hints: Any, np_random: Any = None) -> Timetable:  # noqa: ARG001
    cities = len(hints["city_positions"])
    limit = int(8 * (distance_map.rail.height + distance_map.rail.width + len(agents) / cities))
    departures: list[Any] = [[0, None] for _ in agents]
    arrivals: list[Any] = [[None, limit] for _ in agents]
    return Timetable(departures, arrivals, limit)


def forget_rails() -> None:
    """Empty the library's caches, which are keyed on the map and would keep every map ever made."""
    for cached in _MAP_CACHES:
        cached()


_MAP_CACHES: list[Callable[[], None]] = [
    member.cache_clear
    for owner in RailGridTransitionMap.__mro__
    for member in vars(owner).values()
    if hasattr(member, "cache_clear")
]
