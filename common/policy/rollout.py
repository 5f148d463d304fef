# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Whole episodes in one call: the compiled world and a network's compiled twin, from the first step to the last.

What comes out equals `common.rail.play.play` with `Twin.in_episode`, to the bit: the same kernels, called from compiled
code instead of from Python.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import kernel
from common.levels.level import Level
from common.policy.choosing import choose, draw_counter
from common.policy.compiled import Twin
from common.policy.twin import forward_row, workspace_size
from common.rail.compiled.batches import step_all
from common.rail.compiled.looking import look
from common.rail.compiled.tree import N_NODE_FEATURES
from common.rail.compiled.world import CompiledWorld, Parts
from common.rail.play import Recording
from common.rail.world import MOVE_FORWARD

_NONE = -1


@kernel
def run(
    parts: Parts,
    header: NDArray[np.int64],
    parameters: NDArray[np.float32],
    states: NDArray[np.float32],
    greedy: bool,
    epsilon: float,
    key: np.uint64,
    vectors: NDArray[np.float32],
    times: NDArray[np.int32],
    trains: NDArray[np.int32],
    actions: NDArray[np.int8],
    rewards: NDArray[np.float32],
    arrived_at: NDArray[np.int32],
) -> tuple[int, int]:
    """Run slot 0 to its end; returns the numbers of decisions D and of steps T.

    Args:
        parts: a world of one slot, freshly loaded.
        header: of the network, see `common.policy.packing`.
        parameters: of the network.
        states: [N, S], what trains carry along; overwritten.
        greedy: take the best; the draws are not looked at.
        epsilon: only for action values.
        key: of the episode's stream of exploration.
        vectors: [room, nodes, 12], what was seen, a decision a row; room for N times the step limit.
        times: [room].
        trains: [room].
        actions: [room].
        rewards: [step limit, N].
        arrived_at: [N], the step on which a train arrived, -1 for none.
    """
    size = workspace_size(header)
    places, values, sums = np.empty(size, np.int64), np.empty(size, np.float32), np.empty(size, np.float32)
    n_trains, n_actions = len(arrived_at), header[2]
    out = np.empty(n_actions + 1, np.float32)
    doing = np.empty(parts.deciding.shape, np.int8)
    gained = np.empty(parts.deciding.shape, np.float32)
    decisions = steps = 0
    arrived_at[:] = _NONE
    while not parts.over[0]:
        doing[0, :] = MOVE_FORWARD
        asking = 0
        for train in range(n_trains):
            if parts.deciding[0, train]:
                times[decisions + asking], trains[decisions + asking] = steps, train
                asking += 1
        if asking:
            seen = vectors[decisions : decisions + asking]
            look(parts.batch, parts.sight, parts.deciding, parts.tree, parts.depth, seen)
            for row in range(asking):
                train = trains[decisions + row]
                x = seen[row].reshape(seen[row].size)
                forward_row(header, parameters, x, states[train], out, places, values, sums)
                counter = np.uint64(draw_counter(steps, n_trains, train))
                action = choose(header, out[:n_actions], greedy, epsilon, key, counter)
                doing[0, train] = actions[decisions + row] = action
            decisions += asking
        step_all(
            parts.batch, doing, gained, parts.deciding, parts.arrived, parts.over, parts.decisions, parts.legacy, False
        )
        for train in range(n_trains):
            rewards[steps, train] = gained[0, train]
            if parts.arrived[0, train] and arrived_at[train] == _NONE:
                arrived_at[train] = steps
        steps += 1
    return decisions, steps


class Rollouts:
    """Plays one episode after the other; the arrays that it records into are used again."""

    def __init__(self, max_trains: int) -> None:
        self._world = CompiledWorld(1, max_trains)
        self._vectors = np.empty((0, self._world.n_features // N_NODE_FEATURES, N_NODE_FEATURES), np.float32)
        self._marks = np.empty((2, 0), np.int32)  # times and trains
        self._actions = np.empty(0, np.int8)

    def play(self, level: Level, twin: Twin, epsilon: float, key: int, *, greedy: bool = False) -> Recording:
        """One episode of `level` under the study's rules; see `Twin.in_episode` for the other arguments.

        Raises:
            ValueError: the level has more trains than there is room for.
        """
        self._world.load(0, level)
        self._make_room(level.n_trains * level.max_steps)
        recording = Recording(level, self._world.n_features)
        rewards = np.empty((level.max_steps, level.n_trains), np.float32)
        parts = self._world.parts()
        decisions, steps = run(
            parts,
            twin.header,
            twin.parameters,
            twin.zero_state(level.n_trains),
            greedy,
            epsilon,
            np.uint64(key),
            self._vectors,
            self._marks[0],
            self._marks[1],
            self._actions,
            rewards,
            recording.arrived_at,
        )
        recording.observations = list(self._vectors[:decisions].reshape(decisions, -1).copy())
        recording.times, recording.trains = (marks[:decisions].tolist() for marks in self._marks)
        recording.actions = self._actions[:decisions].tolist()
        recording.rewards = list(rewards[:steps])
        self._look_back(recording, parts)
        return recording

    def _look_back(self, recording: Recording, parts: Parts) -> None:
        asking = np.zeros_like(parts.deciding)
        asking[0, : len(recording.arrived_at)] = recording.arrived_at == _NONE
        count = np.count_nonzero(asking)
        if count:
            seen = np.empty((count, *self._vectors.shape[1:]), np.float32)
            look(parts.batch, parts.sight, asking, parts.tree, parts.depth, seen)
            recording.final_observations[recording.arrived_at == _NONE] = seen.reshape(count, -1)

    def _make_room(self, decisions: int) -> None:
        if decisions > len(self._actions):
            self._vectors = np.empty((decisions, *self._vectors.shape[1:]), np.float32)
            self._marks = np.empty((2, decisions), np.int32)
            self._actions = np.empty(decisions, np.int8)
