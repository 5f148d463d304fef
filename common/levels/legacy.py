"""The levels of the study: flatland 2.2.2's distribution, in compiled code.

Source: "Deep Reinforcement Learning in the Flatland Multi-Agent Environment" (2021), table 5.1, and the
sparse rail and schedule generators of flatland-rl 2.2.2. The same random numbers give the same levels as there. The
library is not needed: what it draws is restated in `common.levels.compiled`.
"""

from railctl.common.levels.compiled.layout import draw_layout
from railctl.common.levels.compiled.trips import legacy_trips
from railctl.common.levels.compiled.twister import State, seeded
from railctl.common.levels.distributions import LegacyLevels
from railctl.common.levels.level import InfeasibleLevelError, Level
from railctl.common.levels.room import room_of
from railctl.common.seeding import stream_key

ROUTE_TRIES = 100  # 2.2.2 gave up on a train after so many pairs of stations
LEVEL_TRIES = 20


def generate(levels: LegacyLevels, seed: int) -> Level:
    """The level of `seed`: a pure function, the same in every process, whatever the global generators hold.

    Raises:
        InfeasibleLevelError: none of `LEVEL_TRIES` derived seeds gave a feasible level.
        TracksLeaveGridError: tracks reach beyond the grid.
    """
    for attempt in range(LEVEL_TRIES):
        derived = stream_key(int(seed), attempt, "level-retry") if attempt else int(seed)
        try:
            return _draw(levels, seeded(derived))
        except InfeasibleLevelError:
            continue
    raise InfeasibleLevelError(f"no feasible level for seed {seed} in {LEVEL_TRIES} tries: make size or cities larger")


def max_episode_steps(height: int, width: int, trains: int, cities_placed: int) -> int:
    """The step limit of 2.2.2, which grows when a city found no place."""
    return int(8 * (height + width + trains / cities_placed))


def _draw(levels: LegacyLevels, state: State) -> Level:
    height, width = levels.size
    room = room_of(levels)
    if room is None:
        raise InfeasibleLevelError(f"{height}x{width} has no room for two cities")
    layout = draw_layout(levels, room, state)
    trips = legacy_trips(layout, levels.trains, ROUTE_TRIES, state)
    if trips.steps.min() < 0:
        raise InfeasibleLevelError(f"no pair of stations is connected in {ROUTE_TRIES} draws")
    return Level(
        grid=layout.grid,
        starts=trips.starts,
        targets=trips.targets,
        max_steps=max_episode_steps(height, width, levels.trains, len(layout.cities)),
    )
