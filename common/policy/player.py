"""Playing leased episodes with whichever engine the run has; both give the same episodes, to the bit."""

from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.levels.level import Level
from common.policy.compiled import Chooser
from common.policy.packing import Layout
from common.rail.normalise import N_FEATURES
from common.rail.play import Stage
from common.rail.world import N_ACTIONS
from common.records.course import Course

MAX_TRAINS = 7  # of the hardest difficulty
NO_ACTIONS = np.zeros(0, np.int8)
Engine = Literal["compiled", "flatland"]


class Acting(NamedTuple):
    """How trains choose: a network, its exploration and the key of the episode's stream of exploration.

    Policies are sampled, action values taken epsilon-greedily, unless `greedy`.
    """

    twin: Chooser
    epsilon: float = 0.0
    key: int = 0
    greedy: bool = False


class Player(Protocol):
    """Plays one episode at a time, whole or in fragments; `states` [N, S] are what recurrent networks carry along."""

    def begin(self, level: Level, actions: NDArray[np.int8] = NO_ACTIONS, steps: int = 0) -> None:
        """Start an episode and take its first `steps`, with the `actions` of all decisions in them.

        Raises:
            ValueError: there are more or fewer decisions than actions, or more trains than there is room for.
        """

    def advance(self, acting: Acting, states: NDArray[np.float32], steps: int | None = None) -> Course:
        """Play on, to the end or for at most `steps`; `states` are carried on in place."""


def play(player: Player, level: Level, acting: Acting) -> Course:
    """A whole episode."""
    player.begin(level)
    return player.advance(acting, acting.twin.zero_state(level.n_trains))


def network_layout(config: NetworkConfig) -> Layout:
    """How the run's network is laid out for its compiled twin."""
    return Layout(config.kind, N_FEATURES, N_ACTIONS, config.hidden)


def player(
    engine: Engine, max_trains: int, on_step: Callable[[], None] = lambda: None, *, has_twin: bool = True
) -> Player:
    """What plays with an engine. `on_step` is called before every step, or before a fragment that takes milliseconds.

    Networks without a compiled twin choose step by step on either engine. Each engine spares the other's imports.
    """
    if engine == "compiled":
        from common.policy.rollout import Rollouts  # noqa: PLC0415
        from common.rail.compiled.world import CompiledWorld  # noqa: PLC0415

        return Rollouts(max_trains, on_step) if has_twin else Stepped(Stage(CompiledWorld(1, max_trains), on_step))
    from common.rail.flatland_world import FlatlandWorld  # noqa: PLC0415

    return Stepped(Stage(FlatlandWorld(slots=1, max_trains=max_trains), on_step))


class Stepped:
    """A `Player` that Python steps."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def begin(self, level: Level, actions: NDArray[np.int8] = NO_ACTIONS, steps: int = 0) -> None:
        self._stage.begin(level, actions, steps)

    def advance(self, acting: Acting, states: NDArray[np.float32], steps: int | None = None) -> Course:
        choose = acting.twin.in_episode(acting.epsilon, acting.key, states, greedy=acting.greedy)
        return self._stage.advance(choose, states, steps)
