"""Drawing a level's rails: what both versions of the library share."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.compiled.cities import (
    Cities,
    by_distance,
    draw_cities,
    even_places,
    pick_places,
    reject_places,
)
from railctl.common.levels.compiled.rails import lay_rails
from railctl.common.levels.compiled.twister import State
from railctl.common.levels.distributions import Generated, LegacyLevels
from railctl.common.levels.room import PADDING, Room


class Layout(NamedTuple):
    """Rails, and the cities that they belong to.

    Attributes:
        grid: [H, W].
        cities: [C, FIELDS], see `common.levels.compiled.cities`.
        radius: of the cities.
    """

    grid: NDArray[np.uint16]
    cities: Cities
    radius: int


def draw_layout(levels: Generated, room: Room, state: State) -> Layout:
    """The rails that the next numbers of a generator make.

    Raises:
        TracksLeaveGridError: some tracks do not fit.
    """
    legacy = isinstance(levels, LegacyLevels)
    height, width = levels.size
    radius = room.rail_pairs + PADDING - room.spared
    wanted = min(levels.cities, room.cities)
    middles = (reject_places if legacy else pick_places)(state, wanted, radius, height, width)
    if len(middles) < 2:
        middles = even_places(wanted, radius, height, width)
    most_tracks = 2 * room.rail_pairs
    most_out = min(levels.rails_between_cities, most_tracks)
    if isinstance(levels, LegacyLevels):
        most_tracks = min(levels.rails_in_city, most_tracks)
    cities = draw_cities(state, middles, most_tracks, most_out, not legacy)
    return Layout(lay_rails(cities, by_distance(middles), radius, levels.size, legacy), cities, radius)
