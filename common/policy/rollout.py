# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Whole episodes, or fragments of them, in one call: the compiled world and a network's compiled twin.

What comes out equals `common.rail.play.Stage` with `Twin.in_episode`, to the bit: the same kernels, called from
compiled code instead of from Python.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.levels.level import Level
from railctl.common.policy.choosing import choose, draw_counter, is_policy, log_probability
from railctl.common.policy.compiled import Twin
from railctl.common.policy.player import NO_ACTIONS, Acting
from railctl.common.policy.twin import forward_row, workspace_size
from railctl.common.rail.compiled.batches import step_all
from railctl.common.rail.compiled.world import CompiledWorld, Parts
from railctl.common.rail.interlocking.asking import allowed, begin, grant, next_asked
from railctl.common.rail.interlocking.signals import ALL_ACTIONS, OFF
from railctl.common.rail.observations.table import look
from railctl.common.rail.planning.advising import Desk, desk_for, new_desk
from railctl.common.rail.planning.judging import Teacher, judge
from railctl.common.rail.world import MOVE_FORWARD
from railctl.common.records.course import NONE, Course, Decisions, columns

ROOM_BYTES = 8 << 20  # of what is noted before Python takes it away: the study's episodes fit in
ROOM_STEPS = 2048


class Teaching(NamedTuple):
    """A teacher, and the desk that it works on; one that tries no orders says nothing."""

    teacher: Teacher
    desk: Desk


SILENT = Teaching(Teacher(orders=0, margin=1, patience=1, key=np.uint64(0)), new_desk(0, 0, 0))


@bare_kernel
def begin_asking(parts: Parts) -> None:
    """Before the trains of slot 0 are asked in a step."""
    if parts.interlocking != OFF:
        begin(parts.batch, 0, parts.interlocking, parts.decisions, parts.signals)


@bare_kernel
def ask(parts: Parts, in_turn: int) -> tuple[int, int]:
    """The train of slot 0 that decides next and what it is allowed: anything, `in_turn`, without an interlocking.

    Behind one they come in another order, as what one is granted binds the next.
    """
    if parts.interlocking == OFF:
        return in_turn, ALL_ACTIONS
    train = next_asked(parts.batch, 0, parts.deciding[0], parts.signals)
    return train, allowed(parts.batch, 0, parts.interlocking, train, parts.signals)


@bare_kernel
def label_of(parts: Parts, train: int, bits: int, teaching: Teaching) -> int:
    """What a teacher would have a train of slot 0 do that is allowed `bits`; NONE if it says nothing."""
    if teaching.teacher.orders == 0:
        return NONE
    return judge(parts.batch, 0, train, bits, parts.decisions, teaching.teacher, teaching.desk)


@bare_kernel
def tick(
    parts: Parts, doing: NDArray[np.int8], gained: NDArray[np.float32], step: int, arrived_at: NDArray[np.int32]
) -> None:
    """One step of slot 0, and who arrived on it."""
    flags = parts.deciding, parts.arrived, parts.over
    step_all(parts.batch, doing, gained, *flags, parts.decisions, parts.legacy, parts.reward, parts.interlocking, False)
    for train in range(len(arrived_at)):
        if parts.arrived[0, train] and arrived_at[train] == NONE:
            arrived_at[train] = step


@kernel
def look_ahead(parts: Parts, trains: NDArray[np.int32], following: NDArray[np.float32]) -> None:
    """What trains of slot 0 see after the step on which they decided, [K, F]; zeros for those that have arrived."""
    asking = np.zeros(parts.deciding.shape, np.bool_)
    for train in trains:
        asking[0, train] = not parts.arrived[0, train]
    seen = np.empty((np.count_nonzero(asking), following.shape[1]), np.float32)
    look(parts.batch, parts.sight, parts.observation, asking, seen)
    following[:] = 0
    row = 0
    for at in range(len(trains)):
        if asking[0, trains[at]]:
            following[at] = seen[row]
            row += 1


@kernel
def repeat(parts: Parts, actions: NDArray[np.int8], steps: int, arrived_at: NDArray[np.int32]) -> int:
    """Take the first `steps` of an episode with the actions [D] of its decisions, unseen; returns how many there were.

    Args:
        parts: a world of one slot, freshly loaded.
        actions: of all decisions, in the order of (time, train); those missing count as MOVE_FORWARD.
        steps: how many.
        arrived_at: [N], the step on which a train arrived, -1 for none; carried on.
    """
    doing = np.empty(parts.deciding.shape, np.int8)
    gained = np.empty(parts.deciding.shape, np.float32)
    decisions = 0
    for step in range(steps):
        doing[0, :] = MOVE_FORWARD
        for train in range(len(arrived_at)):
            if parts.deciding[0, train]:
                if decisions < len(actions):
                    doing[0, train] = actions[decisions]
                decisions += 1
        tick(parts, doing, gained, step, arrived_at)
    return decisions


@kernel
def run(
    parts: Parts,
    header: NDArray[np.int64],
    parameters: NDArray[np.float32],
    states: NDArray[np.float32],
    greedy: bool,
    epsilon: float,
    key: np.uint64,
    teaching: Teaching,
    first_step: int,
    last_step: int,
    notes: Any,
    rewards: NDArray[np.float32],
    arrived_at: NDArray[np.int32],
) -> tuple[int, int]:
    """Run slot 0 until its episode is over, or `last_step` is reached, or there may be no room for another step.

    Args:
        parts: a world of one slot, `first_step` steps into its episode.
        header: of the network, see `common.policy.packing`.
        parameters: of the network.
        states: [N, S], what trains carry along; overwritten.
        greedy: take the best; the draws are not looked at.
        epsilon: see `choosing.choose`.
        key: of the episode's stream of exploration.
        teaching: a teacher, or one that says nothing: with None all of this would be compiled twice.
        first_step: steps of the episode before.
        last_step: where to stop if the episode goes on.
        notes: `common.records.course.Columns` with room for at least N decisions; overwritten. If it has no room for
            what follows them, nobody looks at it.
        rewards: [room, at least N], overwritten.
        arrived_at: [N], the step on which a train arrived, -1 for none; carried on.

    Returns:
        The numbers of decisions and of steps that were noted.
    """
    size = workspace_size(header)
    places, values, sums = np.empty(size, np.int64), np.empty(size, np.float32), np.empty(size, np.float32)
    n_trains, n_actions = len(arrived_at), header[2]
    outputs, rows = np.empty((n_trains, n_actions + 1), np.float32), np.empty(n_trains, np.int64)
    doing = np.empty(parts.deciding.shape, np.int8)
    gained = np.empty(parts.deciding.shape, np.float32)
    decisions, step = 0, first_step
    while step < last_step and not parts.over[0]:
        if decisions + n_trains > len(notes.times) or step - first_step == len(rewards):
            break
        doing[0, :] = MOVE_FORWARD
        asking = 0
        for train in range(n_trains):
            if parts.deciding[0, train]:
                notes.times[decisions + asking], notes.trains[decisions + asking] = step, train
                rows[train] = asking
                asking += 1
        if asking:
            seen = notes.observations[decisions : decisions + asking]
            look(parts.batch, parts.sight, parts.observation, parts.deciding, seen)
            for row in range(asking):
                train = notes.trains[decisions + row]
                forward_row(header, parameters, seen[row], states[train], outputs[row], places, values, sums)
            begin_asking(parts)
            for row in range(asking):
                train, bits = ask(parts, notes.trains[decisions + row])
                at, scores = decisions + rows[train], outputs[rows[train], :n_actions]
                counter = np.uint64(draw_counter(step, n_trains, train))
                label = label_of(parts, train, bits, teaching)
                action = choose(header, scores, bits, label, greedy, epsilon, key, counter)
                grant(parts.batch, 0, parts.interlocking, train, action, parts.signals)
                doing[0, train] = notes.actions[at] = action
                notes.allowed[at], notes.labels[at] = bits, label
                notes.log_probabilities[at] = log_probability(scores, bits, action) if is_policy(header) else 0.0
                notes.values[at] = outputs[rows[train], n_actions] if is_policy(header) else np.float32(0)
            decisions += asking
        tick(parts, doing, gained, step, arrived_at)
        if asking and notes.following.shape[1]:
            new = slice(decisions - asking, decisions)
            look_ahead(parts, notes.trains[new], notes.following[new])
        for train in range(n_trains):
            rewards[step - first_step, train] = gained[0, train]
        step += 1
    return decisions, step - first_step


class Rollouts:
    """A `common.policy.player.Player` in compiled code; the arrays that it notes things in are used again.

    They hold what fits into `room_bytes` and `room_steps`; what is longer is noted piece by piece.
    """

    def __init__(
        self,
        world: CompiledWorld,
        on_step: Callable[[], None] = lambda: None,
        *,
        room_bytes: int = ROOM_BYTES,
        room_steps: int = ROOM_STEPS,
    ) -> None:
        """Play in slot 0 of a world."""
        self._world = world
        self._on_step = on_step
        self._level: Level | None = None
        self._step = 0
        self._arrived_at = np.zeros(0, np.int32)
        max_trains = world.max_trains
        self._room = max(max_trains, room_bytes // (4 * self._world.n_features))  # of decisions
        self._notes = self._empty_notes(following=False)
        self._rewards = np.empty((room_steps, max_trains), np.float32)
        self._desk: Desk | None = None  # of a teacher

    def begin(
        self, level: Level, malfunction_seed: int = 0, actions: NDArray[np.int8] = NO_ACTIONS, steps: int = 0
    ) -> None:
        """See `common.policy.player.Player`."""
        self._world.load(0, level, malfunction_seed)
        self._level, self._step = level, steps
        self._arrived_at = np.full(level.n_trains, NONE, np.int32)
        if repeat(self._world.parts(), actions, steps, self._arrived_at) != len(actions):
            raise ValueError(f"{len(actions)} actions do not fit the first {steps} steps of this level")

    def advance(self, acting: Acting, states: NDArray[np.float32], steps: int | None = None) -> Course:
        """See `common.policy.player.Player`."""
        if self._level is None:
            raise ValueError("nothing to advance: begin an episode first")
        if states.shape != (wanted := (self._level.n_trains, acting.twin.n_state)):  # compiled code would not look
            raise ValueError(f"states have shape {states.shape}, trains and network want {wanted}")
        first_step, parts = self._step, self._world.parts()
        last_step = self._level.max_steps if steps is None else first_step + steps
        if acting.following != bool(self._notes.following.shape[1]):
            self._notes = self._empty_notes(following=acting.following)
        pieces = [self._piece(acting, parts, states, last_step)]
        while self._step < last_step and not parts.over[0]:
            pieces.append(self._piece(acting, parts, states, last_step))
        over = bool(parts.over[0])
        return Course.made(
            level_hash=self._level.content_hash,
            max_steps=self._level.max_steps,
            first_step=first_step,
            over=over,
            decisions=Decisions.joined([decisions for decisions, _ in pieces]),
            rewards=pieces[0][1] if len(pieces) == 1 else np.concatenate([rewards for _, rewards in pieces]),
            arrived_at=self._arrived_at.copy(),
            final_observations=self._look_back(parts, over=over),
            final_allowed=self._allowed_at_end(over=over),
            states=states.copy(),
            score=self._score() if over else None,
        )

    def _score(self) -> float | None:
        score = self._world.score(0)
        return None if np.isnan(score) else score

    def _empty_notes(self, *, following: bool) -> Any:
        n_features = self._world.n_features
        return columns(self._room, n_features, n_features if following else 0)

    def _piece(
        self, acting: Acting, parts: Parts, states: NDArray[np.float32], last_step: int
    ) -> tuple[Decisions, NDArray[np.float32]]:
        """What happens until `last_step` or the end, as far as there is room to note it; `states` are carried on."""
        if not isinstance(acting.twin, Twin):
            raise TypeError(f"{type(acting.twin).__name__} is not compiled: play step by step")
        self._on_step()
        decisions, steps = run(
            parts,
            acting.twin.header,
            acting.twin.parameters,
            states,
            acting.greedy,
            acting.epsilon,
            np.uint64(acting.key),
            self._teaching(acting.teacher, parts),
            self._step,
            last_step,
            self._notes,
            self._rewards,
            self._arrived_at,
        )
        self._step += steps
        noted = Decisions.made(**{name: column[:decisions].copy() for name, column in self._notes._asdict().items()})
        return noted, self._rewards[:steps, : len(self._arrived_at)].copy()

    def _teaching(self, teacher: Teacher | None, parts: Parts) -> Teaching:
        if teacher is None:
            return SILENT
        self._desk = desk_for(parts.batch, int(parts.batch.worlds[0]["max_steps"]), self._desk)
        return Teaching(teacher, self._desk)

    def _look_back(self, parts: Parts, *, over: bool) -> NDArray[np.float32]:
        final = np.zeros((len(self._arrived_at), self._world.n_features), np.float32)
        if not over:
            return final
        stopped = self._arrived_at == NONE
        count = np.count_nonzero(stopped)
        if count:
            asking = np.zeros_like(parts.deciding)
            asking[0, : len(stopped)] = stopped
            seen = np.empty((count, self._world.n_features), np.float32)
            look(parts.batch, parts.sight, parts.observation, asking, seen)
            final[stopped] = seen
        return final

    def _allowed_at_end(self, *, over: bool) -> NDArray[np.uint8]:
        n_trains = len(self._arrived_at)
        return self._world.allowed(0)[:n_trains].copy() if over else np.full(n_trains, ALL_ACTIONS, np.uint8)
