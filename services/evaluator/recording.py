"""Looking on while a policy plays: every moment of the trains, and every decision of a network.

Nothing here changes what is played: a world tells what it is after each step, a network what it was asked.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level
from railctl.common.playback import ARRIVED, BROKEN, JAMMED, LATE, MOVING, STOPPED, WAITING
from railctl.common.policy.compiled import Chooser
from railctl.common.policy.flat import Arrays
from railctl.common.rail.compiled import arrays
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE
from railctl.common.rail.compiled.malfunctions import MalfunctionGenerators
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.play import Choose, Decision
from railctl.common.rail.rewards.deadlocks import find_deadlocks
from railctl.common.records.base import has_infinities
from railctl.common.records.course import NONE

STATE_OF = np.full(arrays.DONE + 1, WAITING, np.int32)  # by flatland's
STATE_OF[arrays.MOVING], STATE_OF[arrays.STOPPED], STATE_OF[arrays.BROKEN] = MOVING, STOPPED, BROKEN
STATE_OF[arrays.DONE] = ARRIVED


class Take(NamedTuple):
    """An episode of N trains as it was seen.

    Attributes:
        moments: [T + 1, N, 6] int32, see `common.playback`.
        deciding: [T + 1, N], whose action mattered then.
    """

    moments: NDArray[np.int32]
    deciding: NDArray[np.bool_]


class WatchedWorld(CompiledWorld):
    """A world of one slot that keeps what happens in it."""

    def __init__(self, max_trains: int, on_step: Callable[[int, int], None], **conditions: Any) -> None:
        """`on_step` hears after each step how many there were, and how many there may be."""
        super().__init__(1, max_trains, **conditions)
        self._on_step = on_step
        self._has_timetable = False
        self._episodes: list[list[tuple[NDArray[np.int32], NDArray[np.bool_]]]] = []

    @property
    def takes(self) -> list[Take]:
        """All episodes since the world was made."""
        return [Take(*map(np.array, zip(*moments, strict=True))) for moments in self._episodes]

    def load(
        self, slot: int, level: Level, malfunction_seed: int = 0, generators: MalfunctionGenerators | None = None
    ) -> None:
        """As `World.load`."""
        super().load(slot, level, malfunction_seed, generators)
        self._has_timetable = level.schedule is not None
        self._episodes.append([])
        self._note()

    def step(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        """As `World.step`."""
        return self._noted(super().step(actions))

    def obey(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        """As `CompiledWorld.obey`."""
        return self._noted(super().obey(actions))

    def _noted(self, rewards: NDArray[np.float32]) -> NDArray[np.float32]:
        self._note()
        world = self.batch.worlds[0]
        self._on_step(int(world["time"]), int(world["max_steps"]))
        return rewards

    def _note(self) -> None:
        world, cells = self.batch.worlds[0], self.batch.cells[0]
        trains = self.batch.trains[0, : world["trains"]]
        stuck = np.zeros(len(trains), np.bool_)
        find_deadlocks(self.batch, 0, stuck)
        off_map = np.where(trains["state"] == arrays.DONE, trains["finish"], trains["start"])
        place = np.where(trains["config"] == NOWHERE, off_map, trains["config"])
        time = np.where(trains["arrived_at"] == NOTHING, world["time"], trains["arrived_at"])
        late = self._has_timetable & (time > trains["latest_arrival"])
        cell = cells[place >> 2]
        flags = stuck * JAMMED | late * LATE
        moment = (STATE_OF[trains["state"]], cell["row"], cell["column"], place & 3, trains["malfunction"], flags)
        self._episodes[-1].append((np.stack(moment, axis=1).astype(np.int32), self.deciding()[0, : len(trains)]))


def side_by_side(takes: list[Take]) -> Take:
    """Episodes of the same level, each with other trains, as if they were one; those that end sooner hold still."""
    length = max(len(take.moments) for take in takes)
    moments = [_held(take.moments, length) for take in takes]
    deciding = [_held(take.deciding, length) for take in takes]
    return Take(np.concatenate(moments, axis=1), np.concatenate(deciding, axis=1))


def _held(rows: NDArray[Any], length: int) -> NDArray[Any]:
    """[length, ...]: rows, the last of which is repeated."""
    held: NDArray[Any] = rows[np.minimum(np.arange(length), len(rows) - 1)]
    return held


class Note(NamedTuple):
    """A decision of a network, with what it was asked; outputs as in `Chooser.outputs`."""

    step: int
    train: int
    action: int
    allowed: int
    observation: NDArray[np.float32]
    outputs: NDArray[np.float32]


class WatchedNetwork(Chooser):
    """A network that keeps what it was asked in an episode, and what came out.

    Attributes:
        notes: in the order in which trains were asked.
    """

    def __init__(self, network: Chooser) -> None:
        self._network = network
        self.header, self.n_state = network.header, network.n_state
        self.notes: list[Note] = []
        self._last = np.zeros(0, np.float32)

    def load(self, tensors: Arrays) -> None:
        """As `Chooser.load`."""
        self._network.load(tensors)

    def outputs(
        self, observations: NDArray[np.float32], state: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """As `Chooser.outputs`.

        Raises:
            ValueError: the outputs are not finite: neither a page nor a picture could show them.
        """
        outputs = self._network.outputs(observations, state)
        if has_infinities(outputs):
            raise ValueError("the network's outputs are not finite, its weights are too large: use another checkpoint")
        self._last = outputs[-1].copy()  # the network may use its memory again
        return outputs

    def in_episode(self, epsilon: float, key: int, states: NDArray[np.float32], *, greedy: bool = False) -> Choose:
        """As `Chooser.in_episode`."""
        decide = super().in_episode(epsilon, key, states, greedy=greedy)

        def noted(
            observation: NDArray[np.float32], step: int, train: int, allowed: int = ALL_ACTIONS, label: int = NONE
        ) -> Decision:
            decision = decide(observation, step, train, allowed, label)
            self.notes.append(Note(step, train, decision.action, allowed, observation, self._last))
            return decision

        return noted
