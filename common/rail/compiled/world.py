"""The `World` of the study, and of flatland-rl 4.3.0, compiled; all slots step in one call.

With the defaults it equals `common.rail.flatland_world.FlatlandWorld` episode by episode, to the bit.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.levels.level import Level
from common.rail.compiled import decisions as decision_modes
from common.rail.compiled import tree as tree_modes
from common.rail.compiled.arrays import DONE, MOST_CELLS, Batch, empty_batch, enlarged
from common.rail.compiled.batches import ASTRAY, NO_ROOM, OFF_GRID, load, step_all
from common.rail.compiled.looking import look, look_at_all
from common.rail.compiled.malfunctions import Malfunctions
from common.rail.compiled.traffic import STUDY, Traffic
from common.rail.compiled.tree import MOST_PREDICTED_STEPS, N_NODE_FEATURES, Sight, nodes_of, sight_of

Rules = Literal["stock", "legacy"]
Tree = Literal["stock", "legacy", "repaired"]
Decisions = Literal["always", "legacy", "cells"]

PREDICTED_STEPS = 30
DEEPEST = 3
_TREES = {"stock": tree_modes.STOCK, "legacy": tree_modes.LEGACY, "repaired": tree_modes.REPAIRED}
_DECISIONS = {"always": decision_modes.ALWAYS, "legacy": decision_modes.LEGACY, "cells": decision_modes.CELLS}


class Parts(NamedTuple):
    """A world taken apart: its state [E slots], the flags that it keeps [E, N], [E, N], [E], and its modes."""

    batch: Batch
    sight: Sight
    deciding: NDArray[np.bool_]
    arrived: NDArray[np.bool_]
    over: NDArray[np.bool_]
    tree: int
    depth: int
    decisions: int
    legacy: bool


class CompiledWorld:
    """E worlds that step together.

    Args:
        slots: E.
        max_trains: N.
        rules: of flatland-rl 4.3.0 (`stock`) or 2.2.2 (`legacy`: speed 1, no timetables, no malfunctions).
        tree: see `common.rail.compiled.tree`.
        decisions: see `common.rail.compiled.decisions`.
        depth: of the trees, 1 to 3.
        predicted_steps: how far the predictor looks.

    Attributes:
        batch: the state, for those who look closer; a `load` may replace it by a larger one.
    """

    def __init__(
        self,
        slots: int,
        max_trains: int,
        *,
        rules: Rules = "legacy",
        tree: Tree = "legacy",
        decisions: Decisions = "cells",
        depth: int = 2,
        predicted_steps: int = PREDICTED_STEPS,
    ) -> None:
        if not 1 <= depth <= DEEPEST:
            raise ValueError(f"depth {depth} is not supported: choose 1 to {DEEPEST}")
        if not 1 <= predicted_steps <= MOST_PREDICTED_STEPS:
            raise ValueError(f"{predicted_steps} predicted steps are not supported: choose 1 to {MOST_PREDICTED_STEPS}")
        self.slots = slots
        self.max_trains = max_trains
        self.n_features = nodes_of(depth) * N_NODE_FEATURES
        self.batch: Batch = empty_batch(slots, max_trains, cells=1, broken_bytes=1)
        self._legacy = rules == "legacy"
        self._tree = _TREES[tree]
        self._decisions = _DECISIONS[decisions]
        self._depth = depth
        self._predicted_steps = predicted_steps
        self._sight = sight_of(self.batch, depth, predicted_steps)
        self._deciding = np.zeros((slots, max_trains), np.bool_)
        self._arrived = np.zeros((slots, max_trains), np.bool_)
        self._over = np.ones(slots, np.bool_)
        self._seen: tuple[NDArray[np.int64], NDArray[np.float32]] | None = None

    def load(self, slot: int, level: Level, traffic: Traffic = STUDY) -> None:
        """Start an episode of `level` in `slot`.

        Raises:
            ValueError: the level does not fit in, leads off the grid, has a target without rails, or its traffic is
                not what the rules know.
        """
        n_trains = level.n_trains
        if n_trains > self.max_trains:
            raise ValueError(f"the level has {n_trains} trains, the world has room for {self.max_trains}")
        if self._legacy and traffic is not STUDY and not traffic.is_plain:
            raise ValueError("the rules of 2.2.2 know speed 1 only, no timetables and no malfunctions: use stock rules")
        orders, unit = traffic.orders(n_trains)
        outcome, number = self._load(slot, level, orders, unit)
        if outcome == NO_ROOM:
            if number > MOST_CELLS:
                raise ValueError(f"the level has {number} cells with rails, {MOST_CELLS} are supported")
            self._make_room(cells=number)
            outcome, number = self._load(slot, level, orders, unit)
        if outcome == OFF_GRID:
            raise ValueError("the level's rails lead off the grid")
        self._seen = None
        if outcome == ASTRAY:
            raise ValueError(f"no train can stand on the target of train {number}")
        if traffic.malfunctions is not None:
            self._take(slot, traffic.malfunctions)

    def _load(self, slot: int, level: Level, orders: NDArray[np.int32], unit: int) -> tuple[int, int]:
        return load(
            self.batch,
            slot,
            np.ascontiguousarray(level.grid, np.uint16),
            np.ascontiguousarray(level.starts, np.int32),
            np.ascontiguousarray(level.targets, np.int32),
            orders,
            unit,
            level.max_steps,
            self._legacy,
            self._decisions,
            self._deciding,
            self._arrived,
            self._over,
        )

    def parts(self) -> Parts:
        """What compiled code needs to run this world itself; valid until the next `load`."""
        flags = self._deciding, self._arrived, self._over
        return Parts(self.batch, self._sight, *flags, self._tree, self._depth, self._decisions, self._legacy)

    def deciding(self) -> NDArray[np.bool_]:
        return self._deciding.copy()

    def arrived(self) -> NDArray[np.bool_]:
        return self._arrived.copy()

    def over(self) -> NDArray[np.bool_]:
        return self._over.copy()

    def observe_deciding(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """What all trains see that must decide, in one call.

        Returns:
            [K, 2]: slot and train, in that order; [K, F]: their vectors. Neither changes later.
        """
        if self._seen is None:
            self._seen = np.argwhere(self._deciding), self._look(self._deciding)
        return self._seen

    def observe(self, slot: int, train: int) -> NDArray[np.float32]:
        self._check_sight(slot, train)
        if self._deciding[slot, train]:
            row = np.count_nonzero(self._deciding[:slot]) + np.count_nonzero(self._deciding[slot, :train])
            vector: NDArray[np.float32] = self.observe_deciding()[1][row].copy()
            return vector
        asking = np.zeros_like(self._deciding)
        asking[slot, train] = True
        alone: NDArray[np.float32] = self._look(asking)[0]
        return alone

    def step(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        """As `World.step`."""
        return self._step(actions, obey=False)

    def obey(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        """As `step`, but the actions of all trains count, as in flatland."""
        return self._step(actions, obey=True)

    def trees(self, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """[E, N, nodes, 12]: the raw trees of all trains, in `out` if given; NaN where there is no node or no sight."""
        shape = self.slots, self.max_trains, nodes_of(self._depth), N_NODE_FEATURES
        trees = np.empty(shape, np.float32) if out is None else out
        if trees.shape != shape or trees.dtype != np.float32 or not trees.flags.c_contiguous:
            raise ValueError(f"trees need a contiguous float32 array of shape {shape}")
        look_at_all(self.batch, self._sight, self._tree, self._depth, trees)
        return trees

    def malfunctions(self, slot: int) -> Malfunctions | None:
        """What the trains of a slot will suffer from the coming step on; None if they never break down."""
        world = self.batch.worlds[slot]
        if not world["breaks"]:
            return None
        return Malfunctions(
            broken=self.batch.broken[slot].copy(),
            shortest=int(world["shortest"]),
            longest=int(world["longest"]),
            draw=int(world["draw"]),
            twister=self.batch.twister[slot].copy(),
        )

    def _step(self, actions: NDArray[np.int8], *, obey: bool) -> NDArray[np.float32]:
        if actions.shape != self._deciding.shape:
            raise ValueError(f"actions of shape {actions.shape} for {self.slots} slots of {self.max_trains} trains")
        rewards = np.empty((self.slots, self.max_trains), np.float32)
        step_all(
            self.batch,
            np.ascontiguousarray(actions, np.int8),
            rewards,
            self._deciding,
            self._arrived,
            self._over,
            self._decisions,
            self._legacy,
            obey,
        )
        self._seen = None
        return rewards

    def _look(self, asking: NDArray[np.bool_]) -> NDArray[np.float32]:
        """[K, F]: the vectors of the marked trains."""
        rows = np.count_nonzero(asking)
        vectors = np.empty((rows, nodes_of(self._depth), N_NODE_FEATURES), np.float32)
        look(self.batch, self._sight, asking, self._tree, self._depth, vectors)
        flat: NDArray[np.float32] = vectors.reshape(rows, self.n_features)
        return flat

    def _check_sight(self, slot: int, train: int) -> None:
        if self.batch.worlds[slot]["trains"] == 0:
            raise ValueError(f"slot {slot} was never loaded")
        if not 0 <= train < self.batch.worlds[slot]["trains"]:
            raise ValueError(f"slot {slot} has no train {train}")
        if self._tree == tree_modes.LEGACY and self.batch.trains[slot, train]["state"] == DONE:
            raise ValueError(f"train {train} has arrived: it sees nothing")

    def _make_room(self, cells: int = 1, broken_bytes: int = 1) -> None:
        if cells > self.batch.cells.shape[1] or broken_bytes > self.batch.broken.shape[1]:
            self.batch = enlarged(self.batch, cells, broken_bytes)
            self._sight = sight_of(self.batch, self._depth, self._predicted_steps)

    def _take(self, slot: int, malfunctions: Malfunctions) -> None:
        self._make_room(broken_bytes=len(malfunctions.broken))
        world = self.batch.worlds[slot]
        world["breaks"] = True
        world["shortest"], world["longest"] = malfunctions.shortest, malfunctions.longest
        world["draw"] = malfunctions.draw
        self.batch.broken[slot] = malfunctions.broken
        self.batch.twister[slot] = malfunctions.twister
