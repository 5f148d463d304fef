"""The tree observation of flatland-rl 2.2.2, over tables of the level; not built on the library.

Source: `TreeObsForRailEnv` and `ShortestPathPredictorForRailEnv` of flatland-rl 2.2.2. Unlike 4.3.0's, the
predicted conflicts are live, trains that have arrived are invisible, and speeds are constant (here 1, without
malfunctions).

A configuration is a cell and a heading, numbered `cell * 4 + heading`. What the rails alone determine (the
stretch of track from a configuration to the next switch, the shortest path from it to a target) is computed on
first use and kept as long as the level; what is left per observation is to look up the trains that are, or will
be, there.
"""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.tree import N_NODE_FEATURES, nodes_of
from railctl.common.rail.decisions import STEPS, exits

PREDICTED_STEPS = 30
NO_MALFUNCTION, FULL_SPEED = 0.0, 1.0
NORTH_SOUTH_EAST_WEST = 0b1000010000100001  # a diamond crossing, which flatland does not take for a switch

_SWITCH, _DEAD_END, _LOOP = range(3)


class _Stretch(NamedTuple):
    """The cells that a train passes from a configuration until it can choose."""

    configurations: tuple[int, ...]
    places: dict[int, list[int]]  # cell -> where in `configurations`
    targets: tuple[tuple[int, int], ...]  # (where, cell) of any train's target
    unusable: int | None  # where the first switch is that joins and cannot be taken
    end: int  # _SWITCH, _DEAD_END or _LOOP


class _Forecast(NamedTuple):
    """Where a train will be if nobody hinders it."""

    configurations: tuple[int, ...]  # [PREDICTED_STEPS + 1]
    cells: frozenset[int]


class _Rails:
    """What the grid says, once per level: successors, stretches and distances."""

    def __init__(self, level: Level) -> None:
        grid = level.grid
        self.width = grid.shape[1]
        ways = exits(grid)
        if (ways[0, ..., 0] | ways[-1, ..., 2]).any() or (ways[:, -1, :, 1] | ways[:, 0, :, 3]).any():
            raise ValueError("the level's rails lead off the grid")
        self.exits = _exit_lists(ways)
        self.bits = _transition_bits(grid, ways)
        self.step = [down * self.width + right for down, right in STEPS]
        self.targets = [int(row) * self.width + int(column) for row, column in level.targets]
        self._predecessors: list[list[int]] = [[] for _ in self.exits]
        for here, headings in enumerate(self.exits):
            for heading in headings:
                self._predecessors[self.after(here, heading)].append(here)
        self._stretches: dict[int, _Stretch] = {}

    def after(self, configuration: int, heading: int) -> int:
        """The configuration of a train that leaves this one towards `heading`."""
        return ((configuration >> 2) + self.step[heading]) * 4 + heading

    def distances(self, cell: int) -> list[float]:
        """Steps from every configuration to `cell`."""
        distance = [inf] * len(self.exits)
        frontier = [cell * 4 + heading for heading in range(4) if self.exits[cell * 4 + heading]]
        steps = 0.0
        while frontier:
            reached = []
            for here in frontier:
                if distance[here] == inf:
                    distance[here] = steps
                    reached += self._predecessors[here]
            frontier = reached
            steps += 1
        return distance

    def stretch(self, start: int) -> _Stretch:
        """The stretch that begins with `start`."""
        known = self._stretches.get(start)
        if known is None:
            known = self._stretches[start] = self._walk(start)
        return known

    def _walk(self, start: int) -> _Stretch:
        passed: list[int] = []
        unusable: int | None = None
        here = start
        while True:
            looped = here in passed
            passed.append(here)
            if looped:
                end = _LOOP
                break
            ways, bits = self.exits[here], self.bits[here >> 2]
            if unusable is None and bits > 2 > len(ways):
                unusable = len(passed) - 1
            if len(ways) != 1 or bits == 1:
                end = _DEAD_END if len(ways) == 1 else _SWITCH if ways else _LOOP
                break
            here = self.after(here, ways[0])
        places: dict[int, list[int]] = {}
        for at, configuration in enumerate(passed):
            places.setdefault(configuration >> 2, []).append(at)
        targets = tuple((at, c >> 2) for at, c in enumerate(passed) if c >> 2 in self.targets)
        return _Stretch(tuple(passed), places, targets, unusable, end)


class LegacyTree:
    """Trees of the trains of one level; `update` says where the trains are, `tree` looks from one of them."""

    def __init__(self, level: Level, depth: int = 2) -> None:
        self._rails = _Rails(level)
        self._nodes = nodes_of(depth)
        self._distances = [self._rails.distances(cell) for cell in self._rails.targets]
        self._forecasts: list[dict[int, _Forecast]] = [{} for _ in self._rails.targets]
        self._hops: list[dict[int, int]] = [{} for _ in self._rails.targets]
        self._now: list[int | None] = [None] * level.n_trains
        self._running: dict[int, int] = {}  # cell -> heading of the train on it
        self._waiting: dict[int, int] = {}  # cell -> trains that wait to depart from it
        self._paths: list[_Forecast | None] = []

    def update(self, configurations: Sequence[int | None], on_map: Sequence[bool]) -> None:
        """Take the trains' places: where they are or will depart from, None for those that have arrived."""
        self._now = list(configurations)
        self._running.clear()
        self._waiting.clear()
        for here, running in zip(configurations, on_map, strict=True):
            if here is not None and running:
                self._running[here >> 2] = here & 3
            elif here is not None:
                self._waiting[here >> 2] = self._waiting.get(here >> 2, 0) + 1
        self._paths = [
            None if here is None else self._forecast(train, here) for train, here in enumerate(configurations)
        ]

    def tree(self, train: int) -> NDArray[np.float32]:
        """[nodes, 12]: the raw features that `train` sees, NaN where there is no node."""
        here = self._now[train]
        if here is None:
            raise ValueError(f"train {train} has arrived: it sees nothing")
        nodes = np.full((self._nodes, N_NODE_FEATURES), np.nan, dtype=np.float32)
        distance = self._distances[train][here]
        nodes[0] = (0, 0, 0, 0, 0, 0, distance, 0, 0, NO_MALFUNCTION, FULL_SPEED, 0)
        ways = self._rails.exits[here]
        facing = ways[0] if len(ways) == 1 else here & 3
        size = self._nodes >> 2  # of a child and all below it
        for heading in ways:
            node = 1 + (heading - facing + 1) % 4 * size
            self._branch(nodes, node, train, self._rails.after(here, heading), steps=1, size=size)
        return nodes

    def _branch(  # noqa: PLR0913
        self, nodes: NDArray[np.float32], node: int, train: int, start: int, *, steps: int, size: int
    ) -> None:
        """Write the node of the stretch from `start`, which is `steps` away, and the nodes below it, in all `size`."""
        stretch = self._rails.stretch(start)
        own, other, length = self._targets(stretch, train)
        last = stretch.configurations[length - 1]
        end_steps = steps + length - 1
        arrives = own is not None
        near, same, opposite, ready = self._trains(stretch, length)
        conflict = self._conflict(stretch, length, train, steps)
        unusable = stretch.unusable  # flatland does not look for one on the own target
        if unusable is not None and unusable >= length - arrives:
            unusable = None
        nodes[node] = (
            inf if own is None else steps + own,
            inf if other is None else steps + other,
            inf if near is None else steps + near,
            conflict,
            inf if unusable is None else steps + unusable,
            inf if stretch.end == _LOOP and not arrives else end_steps,
            0 if arrives else self._distances[train][last],
            same,
            opposite,
            NO_MALFUNCTION,
            FULL_SPEED,
            ready,
        )
        if size == 1 or arrives or stretch.end == _LOOP:
            return
        facing = (last & 3) + (2 if stretch.end == _DEAD_END else 0)  # a dead end is left backwards, as "forward"
        size >>= 2
        for heading in self._rails.exits[last]:
            below = node + 1 + (heading - facing + 1) % 4 * size
            self._branch(nodes, below, train, self._rails.after(last, heading), steps=end_steps + 1, size=size)

    def _targets(self, stretch: _Stretch, train: int) -> tuple[int | None, int | None, int]:
        """Where the own and the first other target are, and how many cells count: up to the own target."""
        other = None
        for at, cell in stretch.targets:
            if cell == self._rails.targets[train]:
                return at, other, at + 1
            if other is None:
                other = at
        return None, other, len(stretch.configurations)

    def _trains(self, stretch: _Stretch, length: int) -> tuple[int | None, int, int, int]:
        """Where the first train is; how many run along, how many against, and how many wait below one."""
        nearest: int | None = None
        same = opposite = ready = 0
        for cell, heading in self._running.items():
            for at in stretch.places.get(cell, ()):
                if at < length:
                    nearest = at if nearest is None else min(nearest, at)
                    ready += self._waiting.get(cell, 0)
                    if stretch.configurations[at] & 3 == heading:
                        same += 1
                    else:
                        opposite += 1
        return nearest, same, opposite, ready

    def _conflict(self, stretch: _Stretch, length: int, train: int, steps: int) -> float:
        """Steps to the first cell where another train is due when this one comes, facing a way out."""
        own = self._paths[train]
        paths = [path for path in self._paths if path and path is not own and not path.cells.isdisjoint(stretch.places)]
        if own is None or not paths:
            return inf
        for at in range(min(length, PREDICTED_STEPS + 1 - steps)):
            if self._meets(stretch.configurations[at], steps + at, paths, own):
                return steps + at
        return inf

    def _meets(self, here: int, time: int, paths: list[_Forecast], own: _Forecast) -> bool:
        """Only the first moment at which others are there counts; then flatland counts this train, too."""
        cell = here >> 2
        for moment in (time, time - 1, min(PREDICTED_STEPS, time + 1)):
            there = [path.configurations[moment] for path in paths if path.configurations[moment] >> 2 == cell]
            if there:
                if own.configurations[moment] >> 2 == cell:
                    there.append(own.configurations[moment])
                return any(other != here and (other + 2) & 3 in self._rails.exits[here] for other in there)
        return False

    def _forecast(self, train: int, start: int) -> _Forecast:
        known = self._forecasts[train].get(start)
        if known is None:
            path = self._shortest_path(train, start)
            known = self._forecasts[train][start] = _Forecast(path, frozenset(c >> 2 for c in path))
        return known

    def _shortest_path(self, train: int, start: int) -> tuple[int, ...]:
        """[PREDICTED_STEPS + 1]: the way to the target; left before forward before right; then it stays.

        As in flatland, the last step of a path that does not reach its target in time is not taken, and a
        train without a way stays where it is.
        """
        target, hops = self._rails.targets[train], self._hops[train]
        if self._distances[train][start] == inf:
            return (start,) * (PREDICTED_STEPS + 1)
        path = [start]
        here = start
        while here >> 2 != target and len(path) < PREDICTED_STEPS:
            ahead = hops.get(here)
            if ahead is None:
                ahead = hops[here] = self._hop(train, here)
            path.append(ahead)
            here = ahead
        return tuple(path + [here] * (PREDICTED_STEPS + 1 - len(path)))

    def _hop(self, train: int, here: int) -> int:
        """The next configuration on the shortest path."""
        ways, facing = self._rails.exits[here], here & 3
        by_turn = sorted(ways, key=lambda way: (way - facing + 1) % 4)
        if len(ways) > 1 and by_turn[-1] == (facing + 2) % 4:
            by_turn.pop()  # flatland's trains turn in dead ends only
        return min((self._rails.after(here, way) for way in by_turn), key=self._distances[train].__getitem__)


def _exit_lists(ways: NDArray[np.bool_]) -> list[tuple[int, ...]]:
    """[H * W * 4]: the headings by which each configuration can be left."""
    flat = ways.reshape(-1, 4)
    lists: list[tuple[int, ...]] = [()] * len(flat)
    for configuration in np.flatnonzero(flat.any(axis=1)).tolist():
        lists[configuration] = tuple(np.flatnonzero(flat[configuration]).tolist())
    return lists


def _transition_bits(grid: NDArray[np.uint16], ways: NDArray[np.bool_]) -> list[int]:
    """[H * W]: how many transitions each cell has; two for a diamond crossing."""
    bits = ways.sum(axis=(2, 3))
    bits[grid == NORTH_SOUTH_EAST_WEST] = 2
    counts: list[int] = bits.reshape(-1).tolist()
    return counts
