"""What the trains of an environment of flatland-rl see, by code of the library's or of ours that is not compiled."""

from typing import Any, Protocol

import numpy as np
from flatland.envs.observations import GlobalObsForRailEnv
from flatland.envs.step_utils.states import TrainState
from numpy.typing import NDArray

from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.levels.level import Level
from railctl.common.rail.legacy_tree import LegacyTree
from railctl.common.rail.library_tree import LibraryTree
from railctl.common.rail.normalise import normalise
from railctl.common.rail.observations.global_map import GlobalObservation
from railctl.common.rail.observations.maps import CHANNELS, LONG_MALFUNCTION_STEPS, MANY_TRAINS
from railctl.common.rail.observations.table import AnyObservation
from railctl.common.rail.observations.tree import TreeObservation


class FlatlandSight(Protocol):
    """What trains see in one episode: `update` after the start and after every step, then `observe`."""

    def update(self) -> None:
        """Take over what has become of the environment."""

    def observe(self, train: int) -> NDArray[np.float32]:
        """[F]: what a train sees."""


def sight_of(
    observation: AnyObservation, rules: Rules, bounds: Bounds | None, env: Any, level: Level
) -> FlatlandSight | None:
    """How an observation comes about for an environment that was just loaded with a level; None: by a mirror of it."""
    if isinstance(observation, GlobalObservation) and bounds is not None:
        return GlobalMaps(env, bounds, legacy=rules == "legacy")
    if isinstance(observation, TreeObservation) and rules == "legacy":
        return LegacyTrees(env, level, observation, bounds)
    if isinstance(observation, TreeObservation) and observation.conflicts == "library":
        return LibraryTrees(env, observation, bounds)
    return None


class LegacyTrees:
    """Trees of 2.2.2."""

    def __init__(self, env: Any, level: Level, observation: TreeObservation, bounds: Bounds | None) -> None:
        self._agents: list[Any] = env.agents
        self._width = level.grid.shape[1]
        self._features, self._journey = observation.features, observation.journey(bounds)
        self._tree = LegacyTree(level, observation.depth)
        self._is_current = False

    def update(self) -> None:
        self._is_current = False

    def tree(self, train: int) -> NDArray[np.float32]:
        """[nodes, 12], raw."""
        if not self._is_current:
            places: list[int | None] = []
            for agent in self._agents:
                here = agent.current_configuration
                if here is None and agent.state != TrainState.DONE:
                    here = agent.initial_configuration
                places.append(None if here is None else (here[0][0] * self._width + here[0][1]) * 4 + int(here[1]))
            self._tree.update(places, [agent.current_configuration is not None for agent in self._agents])
            self._is_current = True
        return self._tree.tree(train)

    def observe(self, train: int) -> NDArray[np.float32]:
        return normalise(self.tree(train), self._features, self._journey)


class LibraryTrees:
    """Trees of 4.3.0."""

    def __init__(self, env: Any, observation: TreeObservation, bounds: Bounds | None) -> None:
        self._features, self._journey = observation.features, observation.journey(bounds)
        self._tree = LibraryTree(env, observation.depth)

    def update(self) -> None:
        self._tree.update()

    def observe(self, train: int) -> NDArray[np.float32]:
        return normalise(self._tree.tree(train), self._features, self._journey)


class GlobalMaps:
    """The library's global observation, scaled as `common.rail.observations.maps` says."""

    def __init__(self, env: Any, bounds: Bounds, *, legacy: bool) -> None:
        self._builder = GlobalObsForRailEnv()  # type: ignore[no-untyped-call]
        self._builder.reset(env)
        self._bounds = bounds
        self._legacy = legacy

    def update(self) -> None:
        """Nothing is kept."""

    def observe(self, train: int) -> NDArray[np.float32]:
        rails, trains, targets = self._builder.get(train)
        own, other, malfunction, speed, ready = np.moveaxis(trains, 2, 0)
        if self._legacy:
            speed = np.where(speed >= 0, 1, speed)  # 2.2.2 shows that of a train that stands, too
        seen = np.zeros((self._bounds.height, self._bounds.width, CHANNELS), np.float32)
        height, width = own.shape
        seen[:height, :width, :16] = rails
        seen[:height, :width, 16] = (own + 1) / 4
        seen[:height, :width, 17] = (other + 1) / 4
        seen[:height, :width, 18] = np.clip(malfunction, 0, LONG_MALFUNCTION_STEPS) / LONG_MALFUNCTION_STEPS
        seen[:height, :width, 19] = np.maximum(speed, 0)
        seen[:height, :width, 20] = np.minimum(ready, MANY_TRAINS) / MANY_TRAINS
        seen[:height, :width, 21:] = targets
        return seen.reshape(-1)
