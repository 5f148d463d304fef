"""The world of the study on flatland-rl 4.3.0: the library steps, under the rules of 2.2.2.

Trains decide where `decisions` says so and follow the rails elsewhere; they see `legacy_tree`, as `normalise`
makes a vector of it. Source of the rules: `flatland_env` and the two modules named.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from flatland.envs.step_utils.states import TrainState
from numpy.typing import NDArray

from common.levels.level import Level
from common.rail.decisions import decision_cells
from common.rail.flatland_env import LegacyActions, LevelEnv
from common.rail.legacy_tree import LegacyTree
from common.rail.normalise import N_FEATURES, normalise
from common.rail.world import MOVE_FORWARD


class FlatlandEpisode:
    """Episodes of one slot, one after the other: `load` a level, then `step` with an action a train."""

    def __init__(self, level: Level) -> None:
        self._env: Any = LevelEnv(level)
        self._start(level)

    def load(self, level: Level) -> None:
        self._env.load(level)
        self._start(level)

    def _start(self, level: Level) -> None:
        self.level = level
        self.over = False
        self._agents: list[Any] = self._env.agents
        self._actions = LegacyActions(self._env)
        self._cells = decision_cells(level.grid)
        self._tree = LegacyTree(level)
        self._tree_is_current = False

    def step(self, actions: Sequence[int]) -> list[float]:
        """One step: the trains' rewards. A committed train follows its earlier action instead."""
        self._actions.step(actions)
        self._tree_is_current = False
        self.over = self._env.dones["__all__"]
        rewards = self._env.rewards_dict
        return [rewards[train] for train in range(self.level.n_trains)]

    def deciding(self) -> list[bool]:
        """Trains that may depart, and those on a decision cell that are not committed to an action."""
        pairs = zip(self._agents, self._actions.committed, strict=True)
        return [self._decides(agent, committed) for agent, committed in pairs]

    def _decides(self, agent: Any, committed: int | None) -> bool:
        here = agent.current_configuration
        if here is None:
            return bool(agent.state == TrainState.READY_TO_DEPART)
        (row, column), heading = here
        return committed is None and bool(self._cells[row, column, heading])

    def arrived(self) -> list[bool]:
        return [agent.state == TrainState.DONE for agent in self._agents]

    def committed(self) -> list[bool]:
        """Trains that try again what they were hindered from."""
        return [action is not None for action in self._actions.committed]

    def configurations(self) -> list[tuple[int, int, int] | None]:
        """Row, column and heading of the trains; None for those that are not on the map."""
        places = (agent.current_configuration for agent in self._agents)
        return [None if here is None else (*here[0], int(here[1])) for here in places]

    def tree(self, train: int) -> NDArray[np.float32]:
        """[21, 12]: the raw tree observation of a train that has not arrived."""
        if not self._tree_is_current:
            self._update_tree()
            self._tree_is_current = True
        return self._tree.tree(train)

    def _update_tree(self) -> None:
        width = self.level.grid.shape[1]
        places: list[int | None] = []
        for agent in self._agents:
            here = agent.current_configuration
            if here is None and agent.state != TrainState.DONE:
                here = agent.initial_configuration
            places.append(None if here is None else (here[0][0] * width + here[0][1]) * 4 + int(here[1]))
        self._tree.update(places, [agent.current_configuration is not None for agent in self._agents])


class FlatlandWorld:
    """A `World` on flatland-rl, one `RailEnv` a slot."""

    n_features = N_FEATURES

    def __init__(self, slots: int, max_trains: int) -> None:
        self.slots = slots
        self.max_trains = max_trains
        self._episodes: list[FlatlandEpisode | None] = [None] * slots
        self._deciding = np.zeros((slots, max_trains), dtype=np.bool_)
        self._arrived = np.zeros((slots, max_trains), dtype=np.bool_)
        self._over = np.ones(slots, dtype=np.bool_)

    def load(self, slot: int, level: Level) -> None:
        if level.n_trains > self.max_trains:
            raise ValueError(f"the level has {level.n_trains} trains, the world has room for {self.max_trains}")
        episode = self._episodes[slot]
        if episode is None:
            episode = self._episodes[slot] = FlatlandEpisode(level)
        else:
            episode.load(level)
        self._deciding[slot] = self._arrived[slot] = False
        self._look(slot, episode)

    def deciding(self) -> NDArray[np.bool_]:
        return self._deciding.copy()

    def observe(self, slot: int, train: int) -> NDArray[np.float32]:
        episode = self._episodes[slot]
        if episode is None:
            raise ValueError(f"slot {slot} was never loaded")
        return normalise(episode.tree(train))

    def step(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        rewards = np.zeros((self.slots, self.max_trains), dtype=np.float32)
        chosen = np.where(self._deciding, actions, MOVE_FORWARD)
        for slot, episode in enumerate(self._episodes):
            if episode is not None and not self._over[slot]:
                trains = episode.level.n_trains
                rewards[slot, :trains] = episode.step(chosen[slot, :trains].tolist())
                self._look(slot, episode)
        return rewards

    def arrived(self) -> NDArray[np.bool_]:
        return self._arrived.copy()

    def over(self) -> NDArray[np.bool_]:
        return self._over.copy()

    def _look(self, slot: int, episode: FlatlandEpisode) -> None:
        """Take over what has become of a slot."""
        trains = episode.level.n_trains
        self._over[slot] = episode.over
        self._arrived[slot, :trains] = episode.arrived()
        self._deciding[slot, :trains] = False if episode.over else episode.deciding()
