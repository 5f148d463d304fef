"""Shortest ways over a level's rails, and a level in numbers; plain Python, for pictures and statistics."""

from collections import deque
from typing import NamedTuple

import numpy as np

from railctl.common.levels.level import Level
from railctl.common.rail.decisions import STEPS, exits

Place = tuple[int, int, int]  # row, column, heading


def shortest_route(level: Level, train: int) -> list[Place] | None:
    """The cells from a train's start to its target, both included, with headings; none if there is no way."""
    ways = exits(level.grid)
    start: Place = (*level.starts[train].tolist(),)
    goal: tuple[int, int] = (*level.targets[train].tolist(),)
    came_from: dict[Place, Place | None] = {start: None}
    queue = deque([start])
    while queue:
        place = queue.popleft()
        row, column, heading = place
        if (row, column) == goal:
            return _route(came_from, place)
        for towards in np.flatnonzero(ways[row, column, heading]).tolist():
            ahead = (row + STEPS[towards][0], column + STEPS[towards][1], towards)
            if ahead not in came_from:
                came_from[ahead] = place
                queue.append(ahead)
    return None


def _route(came_from: dict[Place, Place | None], end: Place) -> list[Place]:
    route = []
    place: Place | None = end
    while place is not None:
        route.append(place)
        place = came_from[place]
    return route[::-1]


class Numbers(NamedTuple):
    """A level in numbers.

    Attributes:
        rail_cells: cells with rails.
        switches: cells where a train of some heading has a choice.
        distances: steps from start to target, a train each; -1 where there is no way.
    """

    rail_cells: int
    switches: int
    distances: list[int]


def numbers(level: Level) -> Numbers:
    """What a level is like."""
    choices = exits(level.grid).sum(axis=3).max(axis=2)
    routes = [shortest_route(level, train) for train in range(level.n_trains)]
    return Numbers(
        rail_cells=int((level.grid != 0).sum()),
        switches=int((choices >= 2).sum()),
        distances=[len(route or ()) - 1 for route in routes],
    )
