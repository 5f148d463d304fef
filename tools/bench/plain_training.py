"""Deep Q-learning as a student writes it over flatland-rl 4.3.0 and torch: what `railctl bench loop` compares with.

One process, one thread, one environment. Trains decide where the study's do, and look at the library's own trees. A
list keeps a transition from each decision of a train to its next, as numpy arrays, out of which batches are stacked.
"""

import random
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from flatland.envs.step_utils.states import TrainState
from numpy.typing import NDArray

from railctl.common.config import RunConfig
from railctl.common.levels.level import Level
from railctl.common.policy.networks import build_network
from railctl.common.rail.decisions import decision_cells
from railctl.common.rail.flatland_env import LegacyActions
from railctl.common.rail.flatland_world import decides
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.world import MOVE_FORWARD, N_ACTIONS
from railctl.common.rules.values import ValueSettings
from railctl.services.learner.textbook.plain_dqn import PlainDqn
from railctl.services.learner.training import Batch
from railctl.tools.bench.policy import choose, observed, study_environment
from railctl.tools.levels.library import forget_rails


class Trained(NamedTuple):
    """An episode that was trained on.

    Attributes:
        at_s: when it was, since any moment before the first.
        steps: of the environment.
        decisions: of all trains.
        updates: made in it.
        learning_s: that these took, with the drawing of batches.
    """

    at_s: float
    steps: int
    decisions: int
    updates: int
    learning_s: float


class Transition(NamedTuple):
    """From a train's decision to its next one, its arrival or the step limit."""

    observation_tm1: NDArray[np.float32]  # [F]
    action_tm1: int
    reward_t: float
    discount_t: float
    observation_t: NDArray[np.float32]  # [F]


@dataclass
class Pending:
    """A decision that the next one will complete."""

    observation: NDArray[np.float32]
    action: int
    reward: float = 0.0
    discount: float = 1.0


def settings_of(config: RunConfig) -> ValueSettings:
    """How a run learns; raises TypeError for one that learns no action values."""
    if not isinstance(config.learning, ValueSettings):
        raise TypeError(f"{config.rule} learns no action values")
    return config.learning


class PlainTraining:
    """Trains a network on one level after another, as the settings of a run say.

    Attributes:
        network: what is trained.
        replay: at most its capacity of transitions, the oldest of which are overwritten.
    """

    def __init__(self, config: RunConfig) -> None:
        """As `config` says; raises TypeError as `settings_of`."""
        self._episodes, self._settings = config.episodes, settings_of(config)
        settings = self._settings
        self.network = build_network(settings.network, config.world.n_features, N_ACTIONS, config.seed)
        self._dqn = PlainDqn(settings.dqn, self.network)
        self.replay: list[Transition] = []
        self._kept = 0  # transitions so far: says which one is overwritten next
        self._steps = self._episode = self._updates = 0
        self._learning_s = 0.0
        self._chance, self._drawing = random.Random(config.seed), np.random.default_rng(config.seed)

    def train(self, level: Level) -> Trained:
        """Play an episode, learn in it, and say what was done."""
        steps, updates, learning_s = self._steps, self._updates, self._learning_s
        decisions = self._play(level, self._settings.epsilon(self._episode, self._episodes))
        self._episode += 1
        forget_rails()
        return Trained(
            time.perf_counter(),
            self._steps - steps,
            decisions,
            self._updates - updates,
            self._learning_s - learning_s,
        )

    def _play(self, level: Level, epsilon: float) -> int:
        """Returns how many decisions there were."""
        env = study_environment(level)
        env.reset()
        driver, cells, decisions = LegacyActions(env), decision_cells(level.grid), 0
        pending: dict[int, Pending] = {}
        while not env.dones["__all__"]:
            committed, actions = driver.committed, [MOVE_FORWARD] * level.n_trains
            deciding = [
                train
                for train, agent in enumerate(env.agents)
                if committed[train] is None and decides(agent, "cells", cells)
            ]
            if deciding:
                observations = observed([env.obs_dict[train] for train in deciding])
                chosen = choose(self.network, observations, epsilon, self._chance)
                for train, observation, action in zip(deciding, observations, chosen, strict=True):
                    self._keep(pending.pop(train, None), observation)
                    pending[train], actions[train] = Pending(observation, action), action
                decisions += len(deciding)
            driver.step(actions)
            self._pay(env, pending)
            self._steps += 1
            if self._steps % self._settings.dqn.learn_every_steps == 0:
                self._learn()
        return decisions

    def _pay(self, env: Any, pending: dict[int, Pending]) -> None:
        """Add a step's rewards to what is pending; complete what has ended."""
        for train, decision in list(pending.items()):
            decision.reward += decision.discount * env.rewards_dict[train]
            decision.discount *= self._settings.discount
            if env.agents[train].state == TrainState.DONE:
                decision.discount = 0.0
                self._keep(pending.pop(train), np.zeros_like(decision.observation))
            elif env.dones["__all__"]:
                self._keep(pending.pop(train), observed([env.obs_dict[train]])[0])

    def _keep(self, decision: Pending | None, following: NDArray[np.float32]) -> None:
        if decision is None:
            return
        transition = Transition(decision.observation, decision.action, decision.reward, decision.discount, following)
        if len(self.replay) < self._settings.replay.capacity:
            self.replay.append(transition)
        else:
            self.replay[self._kept % len(self.replay)] = transition
        self._kept += 1

    def _learn(self) -> None:
        """Make an update, if the replay holds a batch."""
        size = self._settings.dqn.batch_size
        if len(self.replay) < size:
            return
        began = time.perf_counter()
        drawn = [self.replay[place] for place in self._drawing.integers(len(self.replay), size=size).tolist()]
        before, actions, rewards, discounts, after = zip(*drawn, strict=True)
        self._dqn.update(
            Batch(
                np.stack(before),
                np.array(actions, np.int64),
                np.array(rewards, np.float32),
                np.array(discounts, np.float32),
                np.full(size, ALL_ACTIONS),
                np.stack(after),
                np.ones(size, np.float32),
            )
        )
        self._updates += 1
        self._learning_s += time.perf_counter() - began
