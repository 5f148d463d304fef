"""A `World` of either set of rules, compiled; all slots step in one call.

It equals `common.rail.flatland_world.FlatlandWorld` with the same arguments, episode by episode, to the bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.levels.level import Level, Malfunctions
from railctl.common.rail.asking import Asking, allowed_each, asking_of
from railctl.common.rail.compiled.arrays import DONE, MOST_CELLS, Batch, empty_batch, enlarged
from railctl.common.rail.compiled.batches import ASTRAY, NO_ROOM, OFF_GRID, TOO_FAR, break_from_now_on, load, step_all
from railctl.common.rail.compiled.decisions import DECISIONS, Decisions
from railctl.common.rail.compiled.looking import look_at_all
from railctl.common.rail.compiled.malfunctions import WHOLE, MalfunctionGenerators, seeded
from railctl.common.rail.compiled.tree import LEGACY, N_NODE_FEATURES, STOCK, Sight, nodes_of, sight_of
from railctl.common.rail.interlocking.signals import ALL_ACTIONS, INTERLOCKINGS, OFF, Interlocking, Signals, signals_for
from railctl.common.rail.observations.table import AnyObservation, header_of, look
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.rail.orders import Orders, orders_of
from railctl.common.rail.planning.advising import Desk, desk_for
from railctl.common.rail.planning.judging import Teacher, judge
from railctl.common.rail.rewards.delay import score
from railctl.common.rail.rewards.study import StudyReward
from railctl.common.rail.rewards.table import AnyReward, weights_of
from railctl.common.rail.world import check_level

PREDICTED_STEPS = 30
STUDY_TREE, STUDY_REWARD = TreeObservation(), StudyReward()


class Parts(NamedTuple):
    """A world taken apart, for compiled code that runs it.

    Attributes:
        batch: the state of E slots.
        sight: room for looking.
        deciding: [E, N], kept up to date by `step_all`, as the next two.
        arrived: [E, N].
        over: [E].
        observation: what `look` is told.
        decisions: what `step_all` is told of where trains decide,
        legacy: of the rules,
        reward: and of rewards.
        interlocking: its mode, see `common.rail.interlocking.signals`.
        signals: room for it.
    """

    batch: Batch
    sight: Sight
    deciding: NDArray[np.bool_]
    arrived: NDArray[np.bool_]
    over: NDArray[np.bool_]
    observation: NDArray[np.int64]
    decisions: int
    legacy: bool
    reward: NDArray[np.float64]
    interlocking: int
    signals: Signals


class CompiledWorld:
    """E worlds that step together.

    Args:
        slots: E.
        max_trains: N.
        rules: of flatland-rl 4.3.0 (`stock`) or 2.2.2 (`legacy`: speed 1, no timetables, no malfunctions).
        observation: what trains see.
        decisions: see `common.rail.compiled.decisions`.
        reward: what trains are paid.
        interlocking: which actions trains are granted, see `common.rail.interlocking.asking`, also for
        patience: steps; None: endless.
        bounds: of the largest level; None: unknown, which does for observations that do not depend on it.

    Attributes:
        batch: the state, for those who look closer; a `load` may replace it by a larger one.

    Raises:
        ValueError: the observation needs bounds.
    """

    def __init__(
        self,
        slots: int,
        max_trains: int,
        *,
        rules: Rules = "legacy",
        observation: AnyObservation = STUDY_TREE,
        decisions: Decisions = "cells",
        reward: AnyReward = STUDY_REWARD,
        interlocking: Interlocking = "off",
        patience: int | None = None,
        bounds: Bounds | None = None,
    ) -> None:
        self.slots = slots
        self.max_trains = max_trains
        self.n_features = observation.n_features(bounds)
        self.batch: Batch = empty_batch(slots, max_trains, cells=1)
        self._bounds = bounds
        self._legacy = rules == "legacy"
        self._observation = header_of(observation, rules, bounds, decisions)
        self._decisions = DECISIONS[decisions]
        self._reward = weights_of(reward)
        self._interlocking = INTERLOCKINGS[interlocking]
        self._patience = patience
        self._sight = sight_of(self.batch, PREDICTED_STEPS)
        self._signals = signals_for(self.batch, patience)
        self._desk: Desk | None = None  # of the teacher, once it is asked
        self._deciding = np.zeros((slots, max_trains), np.bool_)
        self._arrived = np.zeros((slots, max_trains), np.bool_)
        self._over = np.ones(slots, np.bool_)
        self._seen: tuple[NDArray[np.int64], NDArray[np.float32]] | None = None

    def load(
        self, slot: int, level: Level, malfunction_seed: int = 0, generators: MalfunctionGenerators | None = None
    ) -> None:
        """Start an episode of `level` in `slot`.

        Args:
            slot: which one.
            level: what is played.
            malfunction_seed: of 32 bits, for the generator of malfunctions; without effect if the level has none.
            generators: that generator as it stands, in place of a seeded one.

        Raises:
            ValueError: the level does not fit in, leads off the grid, has a target without rails, or a schedule that is
                not what the rules know; in one line.
        """
        check_level(level, self.max_trains, self._bounds)
        orders = orders_of(level, legacy=self._legacy)
        outcome, number = self._load(slot, level, orders)
        if outcome == NO_ROOM:
            if number > MOST_CELLS:
                raise ValueError(f"the level has {number} cells with rails, {MOST_CELLS} are supported")
            self._make_room(cells=number)
            outcome, number = self._load(slot, level, orders)
        if outcome == OFF_GRID:
            raise ValueError("the level's rails lead off the grid")
        self._seen = None
        if outcome == ASTRAY:
            raise ValueError(f"no train can stand on the target of train {number}")
        if outcome == TOO_FAR:
            raise ValueError("the level has places too far from a target: 32,766 cells are supported")
        malfunctions = None if level.schedule is None else level.schedule.malfunctions
        if malfunctions is not None:
            self._break(slot, malfunctions, seeded(malfunction_seed) if generators is None else generators)

    def _load(self, slot: int, level: Level, orders: Orders) -> tuple[int, int]:
        return load(
            self.batch,
            slot,
            np.ascontiguousarray(level.grid, np.uint16),
            np.ascontiguousarray(level.starts, np.int32),
            np.ascontiguousarray(level.targets, np.int32),
            orders.trains,
            orders.unit,
            level.max_steps,
            self._legacy,
            self._decisions,
            self._deciding,
            self._arrived,
            self._over,
        )

    def _break(self, slot: int, malfunctions: Malfunctions, generators: MalfunctionGenerators) -> None:
        rate, shortest, longest = malfunctions
        self._make_room(breaks=True)
        self.batch.uniforms[slot] = generators.origin
        if generators.later is not None:
            self.batch.later[slot] = generators.later
        chance = float(1 - np.exp(-rate)) * WHOLE
        goes_on = generators.later is not None
        break_from_now_on(self.batch, slot, chance, shortest, longest, generators.draw, goes_on)

    def parts(self) -> Parts:
        """What compiled code needs to run this world itself; valid until the next `load`."""
        return Parts(
            self.batch,
            self._sight,
            self._deciding,
            self._arrived,
            self._over,
            self._observation,
            self._decisions,
            self._legacy,
            self._reward,
            self._interlocking,
            self._signals,
        )

    def deciding(self) -> NDArray[np.bool_]:
        return self._deciding.copy()

    def arrived(self) -> NDArray[np.bool_]:
        return self._arrived.copy()

    def over(self) -> NDArray[np.bool_]:
        return self._over.copy()

    def score(self, slot: int) -> float:
        """As `World.score`."""
        return float(score(self.batch, slot, self._legacy))

    def observe_deciding(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """What all trains see that must decide, in one call.

        Returns:
            [K, 2]: slot and train, in that order; [K, F]: their vectors. Neither changes later.
        """
        if self._seen is None:
            self._seen = np.argwhere(self._deciding), self._look(self._deciding)
        return self._seen

    def observe(self, slot: int, train: int) -> NDArray[np.float32]:
        """As `World.observe`."""
        self._check_sight(slot, train)
        if self._deciding[slot, train]:
            row = np.count_nonzero(self._deciding[:slot]) + np.count_nonzero(self._deciding[slot, :train])
            vector: NDArray[np.float32] = self.observe_deciding()[1][row].copy()
            return vector
        asking = np.zeros_like(self._deciding)
        asking[slot, train] = True
        alone: NDArray[np.float32] = self._look(asking)[0]
        return alone

    def ask(self, slot: int) -> Asking:
        """As `World.ask`."""
        return asking_of(self.batch, slot, self._interlocking, self._decisions, self._signals, self._deciding[slot])

    def allowed(self, slot: int) -> NDArray[np.uint8]:
        """As `World.allowed`."""
        bits = np.full(self.max_trains, ALL_ACTIONS, np.uint8)
        if self._interlocking != OFF:
            allowed_each(self.batch, slot, self._interlocking, self._decisions, self._signals, bits)
        return bits

    def advise(self, slot: int, train: int, allowed: int, teacher: Teacher) -> int:
        """As `World.advise`."""
        self._desk = desk_for(self.batch, int(self.batch.worlds[slot]["max_steps"]), self._desk)
        return int(judge(self.batch, slot, train, allowed, self._decisions, teacher, self._desk))

    def step(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        """As `World.step`."""
        return self._step(actions, obey=False)

    def obey(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        """As `step`, but the actions of all trains count, as in flatland."""
        return self._step(actions, obey=True)

    def trees(self, out: NDArray[np.float32] | None = None, *, depth: int = 2) -> NDArray[np.float32]:
        """[E, N, nodes, 12]: the rules' raw trees of all trains; NaN where there is no node or no sight.

        Args:
            out: what is overwritten and returned, if given.
            depth: 1 to 3.
        """
        shape = self.slots, self.max_trains, nodes_of(depth), N_NODE_FEATURES
        trees = np.empty(shape, np.float32) if out is None else out
        if trees.shape != shape or trees.dtype != np.float32 or not trees.flags.c_contiguous:
            raise ValueError(f"trees need a contiguous float32 array of shape {shape}")
        look_at_all(self.batch, self._sight, LEGACY if self._legacy else STOCK, depth, trees)
        return trees

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
            self._reward,
            self._interlocking,
            obey,
        )
        self._seen = None
        return rewards

    def _look(self, asking: NDArray[np.bool_]) -> NDArray[np.float32]:
        """[K, F]: the vectors of the marked trains."""
        vectors = np.empty((np.count_nonzero(asking), self.n_features), np.float32)
        look(self.batch, self._sight, self._observation, asking, vectors)
        return vectors

    def _check_sight(self, slot: int, train: int) -> None:
        if self.batch.worlds[slot]["trains"] == 0:
            raise ValueError(f"slot {slot} was never loaded")
        if not 0 <= train < self.batch.worlds[slot]["trains"]:
            raise ValueError(f"slot {slot} has no train {train}")
        if self._legacy and self.batch.trains[slot, train]["state"] == DONE:
            raise ValueError(f"train {train} has arrived: it sees nothing")

    def _make_room(self, cells: int = 1, *, breaks: bool = False) -> None:
        if cells > self.batch.cells.shape[1] or (breaks and self.batch.known.shape[1] == 1):
            self.batch = enlarged(self.batch, cells, breaks=breaks)
            self._sight = sight_of(self.batch, PREDICTED_STEPS)
            self._signals = signals_for(self.batch, self._patience)
