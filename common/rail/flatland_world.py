"""A `World` of either set of rules on flatland-rl 4.3.0: the library steps; nothing here is compiled if it need not be.

It is the judge of `common.rail.compiled.world`: dynamics, stock trees, global maps, delays and scores are the library's
own; the rules and trees of 2.2.2 come from `flatland_env` and `legacy_tree`; for what nobody else has (local maps,
repaired trees, shaped rewards) the library's state is copied into the compiled arrays (`mirror`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from flatland.envs.rewards import DefaultRewards
from flatland.envs.step_utils.states import TrainState
from numpy.typing import NDArray

from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.levels.level import Level
from railctl.common.rail.asking import Asking, Free
from railctl.common.rail.compiled.decisions import Decisions
from railctl.common.rail.compiled.world import STUDY_REWARD, STUDY_TREE
from railctl.common.rail.decisions import decision_cells
from railctl.common.rail.flatland_env import ACTIONS, LegacyActions, LevelEnv, StudyRewards
from railctl.common.rail.flatland_sights import LegacyTrees, sight_of
from railctl.common.rail.interlocking.signals import ALL_ACTIONS, Interlocking
from railctl.common.rail.mirror import Mirror
from railctl.common.rail.observations.table import AnyObservation
from railctl.common.rail.orders import orders_of
from railctl.common.rail.planning.judging import Teacher
from railctl.common.rail.rewards.table import AnyReward
from railctl.common.rail.world import MOVE_FORWARD, check_level


@dataclass(frozen=True)
class Settings:
    """What episodes have in common; see `FlatlandWorld`."""

    rules: Rules = "legacy"
    observation: AnyObservation = STUDY_TREE
    decisions: Decisions = "cells"
    reward: AnyReward = STUDY_REWARD
    interlocking: Interlocking = "off"
    patience: int | None = None
    bounds: Bounds | None = None


STUDY = Settings()


class FlatlandEpisode:
    """Episodes of one slot, one after the other: `load` a level, then `step` with an action a train."""

    def __init__(self, level: Level, settings: Settings = STUDY, malfunction_seed: int = 0) -> None:
        orders_of(level, legacy=settings.rules == "legacy")
        self._settings = settings
        self._pays_by_mirror = settings.reward.kind not in ("study", "delay")
        self._has_signals = settings.interlocking != "off"
        self._binds = self._has_signals and settings.rules == "stock"
        study = settings.rules == "legacy" and settings.reward.kind != "delay"
        rewards: Any = StudyRewards if study else DefaultRewards
        self._env: Any = LevelEnv(level, settings.rules, rewards, malfunction_seed)
        self._start(level)

    def load(self, level: Level, malfunction_seed: int = 0) -> None:
        orders_of(level, legacy=self._settings.rules == "legacy")
        self._env.load(level, malfunction_seed)
        self._start(level)

    def _start(self, level: Level) -> None:
        settings = self._settings
        self.level = level
        self.over = False
        self._agents: list[Any] = self._env.agents
        self._actions = LegacyActions(self._env) if settings.rules == "legacy" else None
        self._cells = decision_cells(level.grid)
        self._delays = np.zeros(level.n_trains)
        told = settings.observation, settings.rules, settings.bounds
        sight = sight_of(*told, self._env, level)
        self._mirror: Mirror | None = None
        if sight is None or self._pays_by_mirror or self._has_signals:
            self._mirror = self._made_mirror()
        self._sight: Any = self._mirror if sight is None else sight
        self._look()

    def _made_mirror(self) -> Mirror:
        settings = self._settings
        told = settings.observation, settings.rules, settings.bounds, settings.decisions, settings.reward
        return Mirror(self._env, self.level, *told, settings.interlocking, settings.patience, self._actions)

    def step(self, actions: Sequence[int]) -> list[float]:
        """One step: the trains' rewards. A committed train follows its earlier action instead."""
        decided = np.array(self.deciding()) if self._binds else None
        if self._actions is None:
            self._env.step({train: ACTIONS[action] for train, action in enumerate(actions)})
        else:
            self._actions.step(actions)
        self.over = self._env.dones["__all__"]
        self._look()
        if decided is not None and self._mirror is not None:
            self._mirror.bind(actions, decided)
        paid = [self._env.rewards_dict[train] for train in range(self.level.n_trains)]
        if self._actions is None:
            self._delays += np.array(paid, np.float64)
        if self._pays_by_mirror and self._mirror is not None:
            rewards: list[float] = self._mirror.rewards().tolist()
            return rewards
        return self._study_rewards() if self._settings.reward.kind == "study" else paid

    def _look(self) -> None:
        if self._mirror is not None and self._mirror is not self._sight:
            self._mirror.update()
        self._sight.update()

    def _study_rewards(self) -> list[float]:
        all_arrived = float(all(self.arrived()))
        return [all_arrived - (not arrived) for arrived in self.arrived()]

    def score(self) -> float:
        """See `World.score`."""
        if self._actions is not None or not self.over:
            return float("nan")
        size = {"num_agents": self.level.n_trains, "max_episode_steps": self.level.max_steps}
        return float(DefaultRewards().normalize(*self._delays, **size))

    def deciding(self) -> list[bool]:
        """Trains that may depart, and those on the map that the rule of decisions names, if not committed."""
        committed = self.committed()
        return [
            not committed[train] and decides(agent, self._settings.decisions, self._cells)
            for train, agent in enumerate(self._agents)
        ]

    def ask(self, deciding: NDArray[np.bool_]) -> Asking:
        """As `World.ask`, of the trains of which `deciding` [N] holds."""
        return Free(deciding) if self._mirror is None else self._mirror.ask(deciding)

    def allowed(self) -> NDArray[np.uint8]:
        """[N], as `World.allowed`."""
        if self._mirror is None:
            return np.full(self.level.n_trains, ALL_ACTIONS, np.uint8)
        return self._mirror.allowed()

    def advise(self, train: int, allowed: int, teacher: Teacher) -> int:
        """As `World.advise`."""
        if self._mirror is None:
            self._mirror = self._made_mirror()
            self._mirror.update()
        return self._mirror.advise(train, allowed, teacher)

    def unasked(self) -> list[int]:
        """[N]: what the trains are told that do not decide; see `common.rail.asking.unasked`."""
        return [MOVE_FORWARD] * self.level.n_trains if self._mirror is None else self._mirror.unasked()

    def arrived(self) -> list[bool]:
        return [agent.state == TrainState.DONE for agent in self._agents]

    def committed(self) -> list[bool]:
        """Trains that try again what they were hindered from."""
        if self._actions is None:
            return [False] * self.level.n_trains
        return [action is not None for action in self._actions.committed]

    def configurations(self) -> list[tuple[int, int, int] | None]:
        """Row, column and heading of the trains; None for those that are not on the map."""
        places = (agent.current_configuration for agent in self._agents)
        return [None if here is None else (*here[0], int(here[1])) for here in places]

    def observe(self, train: int) -> NDArray[np.float32]:
        """[F]: what a train sees that has not arrived."""
        if self._actions is not None and self.arrived()[train]:
            raise ValueError(f"train {train} has arrived: it sees nothing")
        vector: NDArray[np.float32] = self._sight.observe(train)
        return vector

    def tree(self, train: int) -> NDArray[np.float32]:
        """[nodes, 12]: the raw tree observation of a train that has not arrived, under legacy rules."""
        if not isinstance(self._sight, LegacyTrees):
            raise TypeError("raw trees are those of 2.2.2")
        return self._sight.tree(train)


def decides(agent: Any, decisions: Decisions, cells: NDArray[np.bool_]) -> bool:
    """Whether one of the library's trains decides that is not committed; `cells` are those of `decision_cells`."""
    here = agent.current_configuration
    if here is None:
        return bool(agent.state == TrainState.READY_TO_DEPART)
    if decisions == "legacy":
        return True
    if not agent.speed_counter.is_cell_exit(agent.speed_counter.max_speed):
        return False
    (row, column), heading = here
    may = cells[row, column, heading] and not agent.malfunction_handler.in_malfunction
    return decisions == "always" or bool(may)


class FlatlandWorld:
    """A `World` on flatland-rl, one `RailEnv` a slot; its arguments are those of `CompiledWorld`."""

    def __init__(  # noqa: PLR0913
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
        self._settings = Settings(rules, observation, decisions, reward, interlocking, patience, bounds)
        self._episodes: list[FlatlandEpisode | None] = [None] * slots
        self._deciding = np.zeros((slots, max_trains), dtype=np.bool_)
        self._arrived = np.zeros((slots, max_trains), dtype=np.bool_)
        self._over = np.ones(slots, dtype=np.bool_)

    def load(self, slot: int, level: Level, malfunction_seed: int = 0) -> None:
        check_level(level, self.max_trains, self._settings.bounds)
        episode = self._episodes[slot]
        if episode is None:
            episode = self._episodes[slot] = FlatlandEpisode(level, self._settings, malfunction_seed)
        else:
            episode.load(level, malfunction_seed)
        self._deciding[slot] = self._arrived[slot] = False
        self._look(slot, episode)

    def deciding(self) -> NDArray[np.bool_]:
        return self._deciding.copy()

    def observe(self, slot: int, train: int) -> NDArray[np.float32]:
        return self._episode(slot).observe(train)

    def score(self, slot: int) -> float:
        episode = self._episodes[slot]
        return float("nan") if episode is None else episode.score()

    def advise(self, slot: int, train: int, allowed: int, teacher: Teacher) -> int:
        return self._episode(slot).advise(train, allowed, teacher)

    def ask(self, slot: int) -> Asking:
        episode = self._episode(slot)
        return episode.ask(self._deciding[slot, : episode.level.n_trains])

    def allowed(self, slot: int) -> NDArray[np.uint8]:
        bits = np.full(self.max_trains, ALL_ACTIONS, np.uint8)
        episode = self._episode(slot)
        bits[: episode.level.n_trains] = episode.allowed()
        return bits

    def step(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        rewards = np.zeros((self.slots, self.max_trains), dtype=np.float32)
        for slot, episode in enumerate(self._episodes):
            if episode is not None and not self._over[slot]:
                trains = episode.level.n_trains
                chosen = np.where(self._deciding[slot, :trains], actions[slot, :trains], episode.unasked())
                rewards[slot, :trains] = episode.step(chosen.tolist())
                self._look(slot, episode)
        return rewards

    def arrived(self) -> NDArray[np.bool_]:
        return self._arrived.copy()

    def over(self) -> NDArray[np.bool_]:
        return self._over.copy()

    def _episode(self, slot: int) -> FlatlandEpisode:
        episode = self._episodes[slot]
        if episode is None:
            raise ValueError(f"slot {slot} was never loaded")
        return episode

    def _look(self, slot: int, episode: FlatlandEpisode) -> None:
        """Take over what has become of a slot."""
        trains = episode.level.n_trains
        self._over[slot] = episode.over
        self._arrived[slot, :trains] = episode.arrived()
        self._deciding[slot, :trains] = False if episode.over else episode.deciding()
