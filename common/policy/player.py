"""Playing leased episodes with whichever engine the run has; both give the same episodes, to the bit."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from railctl.common.config import RunConfig
from railctl.common.levels.distributions import Rules
from railctl.common.levels.level import Level
from railctl.common.policy.compiled import Chooser, Twin
from railctl.common.policy.packing import Layout
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.planning.judging import Teacher
from railctl.common.rail.play import Stage
from railctl.common.rail.world import N_ACTIONS
from railctl.common.records.course import Course
from railctl.common.rules.settings import NetworkConfig
from railctl.common.world import WorldSpec

NO_ACTIONS = np.zeros(0, np.int8)
Engine = Literal["compiled", "flatland"]


class Acting(NamedTuple):
    """How trains choose: a network, its exploration and the key of the episode's stream of exploration.

    Policies are sampled, action values taken epsilon-greedily, unless `greedy`. A teacher is asked for every decision;
    policies do as it would with the probability `epsilon`. If they are wanted, the observations `following` each
    decision are noted: those of its train one step later.
    """

    twin: Chooser
    epsilon: float = 0.0
    key: int = 0
    greedy: bool = False
    teacher: Teacher | None = None
    following: bool = False


class Player(Protocol):
    """Plays one episode at a time, whole or in fragments; `states` [N, S] are what recurrent networks carry along."""

    def begin(
        self, level: Level, malfunction_seed: int = 0, actions: NDArray[np.int8] = NO_ACTIONS, steps: int = 0
    ) -> None:
        """Start an episode and take its first `steps`, with the `actions` of all decisions in them.

        Raises:
            ValueError: there are more or fewer decisions than actions, or more trains than there is room for.
        """

    def advance(self, acting: Acting, states: NDArray[np.float32], steps: int | None = None) -> Course:
        """Play on, to the end or for at most `steps`; `states` are carried on in place."""


def play(player: Player, level: Level, acting: Acting, malfunction_seed: int = 0) -> Course:
    """A whole episode."""
    player.begin(level, malfunction_seed)
    return player.advance(acting, acting.twin.zero_state(level.n_trains))


def network_layout(config: NetworkConfig, n_features: int) -> Layout:
    """How the run's network is laid out for its compiled twin."""
    return Layout(config.kind, n_features, N_ACTIONS, config.hidden)


def player(  # noqa: PLR0913  (a world, and what plays it)
    engine: Engine,
    world: WorldSpec,
    rules: Rules,
    max_trains: int,
    on_step: Callable[[], None] = lambda: None,
    *,
    has_twin: bool = True,
) -> Player:
    """What plays levels of a rule set, with at most so many trains, under the conditions of a world.

    `on_step` is called before every step, or before a fragment that takes milliseconds. Networks without a compiled
    twin choose step by step on either engine. Each engine spares the other's imports.
    """
    if engine == "compiled":
        from railctl.common.policy.rollout import Rollouts  # noqa: PLC0415

        compiled = compiled_world(world, rules, max_trains)
        return Rollouts(compiled, on_step) if has_twin else Stepped(Stage(compiled, on_step))
    from railctl.common.rail.flatland_world import FlatlandWorld  # noqa: PLC0415

    return Stepped(Stage(FlatlandWorld(1, max_trains, **conditions(world, rules)), on_step))


def compiled_world(world: WorldSpec, rules: Rules, max_trains: int) -> CompiledWorld:
    """A compiled world of one slot under the conditions of a world."""
    return CompiledWorld(1, max_trains, **conditions(world, rules))


def conditions(world: WorldSpec, rules: Rules) -> dict[str, Any]:
    """The arguments of both engines' worlds."""
    return {
        "rules": rules,
        "observation": world.observation,
        "decisions": world.decisions,
        "reward": world.reward,
        "interlocking": world.interlocking,
        "patience": world.patience,
        "bounds": world.bounds,
    }


def chooser_of(config: RunConfig) -> Chooser:
    """The network of a run, to act with: the compiled twin, or the rule's own module."""
    n_features = config.world.n_features
    module = config.learning.module(n_features, N_ACTIONS, config.seed)
    if module is None:
        return Twin(network_layout(config.learning.network, n_features))
    from railctl.common.policy.modules import ModuleChooser  # noqa: PLC0415  (torch takes seconds)

    return ModuleChooser(module, n_features, N_ACTIONS, is_policy=config.learning.has_probabilities)


def n_state_of(config: RunConfig) -> int:
    """S, the numbers that a train of a run carries from one decision to the next; a rule's own module keeps none."""
    learning = config.learning
    return 0 if learning.brings_module else network_layout(learning.network, config.world.n_features).n_state


class Players:
    """A player for each of a run's level distributions, made when it is first asked for."""

    def __init__(self, config: RunConfig, chooser: Chooser, on_step: Callable[[], None] = lambda: None) -> None:
        self._config, self._has_twin, self._on_step = config, isinstance(chooser, Twin), on_step
        self._made: dict[str, Player] = {}

    def of(self, name: str) -> Player:
        """The player of a distribution."""
        if name not in self._made:
            world = self._config.world
            rules, trains = world.levels[name].rules, world.levels[name].bounds.trains
            engine = self._config.engine
            self._made[name] = player(engine, world, rules, trains, self._on_step, has_twin=self._has_twin)
        return self._made[name]


class Stepped:
    """A `Player` that Python steps."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def begin(
        self, level: Level, malfunction_seed: int = 0, actions: NDArray[np.int8] = NO_ACTIONS, steps: int = 0
    ) -> None:
        self._stage.begin(level, malfunction_seed, actions, steps)

    def advance(self, acting: Acting, states: NDArray[np.float32], steps: int | None = None) -> Course:
        choose = acting.twin.in_episode(acting.epsilon, acting.key, states, greedy=acting.greedy)
        return self._stage.advance(choose, states, steps, acting.teacher, following=acting.following)
