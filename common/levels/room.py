"""Whether a distribution's cities fit on its grid, and how large they are; known before anything is generated.

Source: `SparseRailGen.generate` of flatland-rl 4.3.0, whose rule 2.2.2 shares: a city is a square of radius `pairs of
rails + 2`, and there must be room for two. Where there is none the library gives up. Ours goes on, first with fewer
pairs of rails, which are a maximum anyway, then with cities that are up to two cells smaller on every side: so 10x10
is possible. Where the library can do it, nothing differs from it.
"""

from math import ceil
from typing import NamedTuple

from railctl.common.levels.distributions import Generated, LegacyLevels
from railctl.common.strict import ConfigError

PADDING = 2  # cells around the rails of a city, on every side, if there is room
MARGIN = 2  # of the grid, in which there are no cities


class Room(NamedTuple):
    """What fits.

    Attributes:
        cities: at most so many.
        rail_pairs: in a city, at most.
        spared: cells by which the radius of a city is less than the library's.
    """

    cities: int
    rail_pairs: int
    spared: int


def room_of(levels: Generated) -> Room | None:
    """What fits on the grid of a distribution; None: not even two cities."""
    pairs = ceil(levels.rails_in_city / 2) if isinstance(levels, LegacyLevels) else levels.rail_pairs_in_city
    rows, columns = levels.size
    choices = [(fewer, 0) for fewer in range(pairs, 0, -1)] + [(1, spared) for spared in range(1, PADDING + 1)]
    for rail_pairs, spared in choices:
        side = 2 * (rail_pairs + PADDING - spared + 1)
        cities = ((rows - MARGIN) // side) * ((columns - MARGIN) // side)
        if cities >= 2:
            return Room(cities, rail_pairs, spared)
    return None


def check_room(name: str, levels: Generated) -> None:
    """Refuse a distribution that can never be generated.

    Raises:
        ConfigError: in one line, field, value and remedy.
    """
    room = room_of(levels)
    if room is None:
        raise ConfigError(f"levels.{name}.size {list(levels.size)} has no room for two cities: make it [10, 6] or more")
    if levels.cities > room.cities:
        raise ConfigError(
            f"levels.{name}.cities {levels.cities}: no more than {room.cities} fit on {levels.size[0]}x"
            f"{levels.size[1]}: lower it, or make size larger"
        )
