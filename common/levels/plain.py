"""Whether a level's schedule says more than the study's rules do anyway."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level


def usable_headings(level: Level) -> NDArray[np.int32]:
    """[N]: a bit for each heading that a train can have at its target (bit 0 north)."""
    cells = level.grid[level.targets[:, 0], level.targets[:, 1]].astype(np.int32)
    headings = np.arange(4)
    ways = cells[:, None] >> (12 - 4 * headings) & 15
    usable: NDArray[np.int32] = ((ways != 0) << headings).sum(axis=1).astype(np.int32)
    return usable


def is_plain(level: Level) -> bool:
    """All trains run at 1, depart at any time, may arrive until the step limit, with any heading; none breaks down."""
    schedule = level.schedule
    if schedule is None:
        return True
    headings = schedule.target_headings
    return bool(
        schedule.malfunctions is None
        and (schedule.speeds[:, 0] == schedule.speeds[:, 1]).all()
        and (schedule.earliest_departures == 0).all()
        and (schedule.latest_arrivals == level.max_steps).all()
        and ((headings == 0) | (headings == usable_headings(level))).all()
    )
