"""The study's world as a PettingZoo `ParallelEnv`: the compiled world, the training levels, an agent a train.

Source of the interface: "PettingZoo: Gym for Multi-Agent Reinforcement Learning", Terry et al. (2021,
arXiv:2009.14471). Observations are the normalised trees of `common.rail.normalise`, actions and rewards flatland's
and the study's.

Trains decide at few steps only (`decisions`). All others get an observation, too, but their actions do not count:
`infos[agent]["deciding"]` says so, and `infos[agent]["action_mask"]` leaves them MOVE_FORWARD alone.

The study gives 1 to all trains on the step on which the last one arrives. Those that arrived before are no agents any
more: `infos[agent]["team_reward"]` is the sum over all trains, whose sum over an episode, divided by trains and step
limit, is the normalised return.
"""

import secrets
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Discrete, Space
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from common.levels.distributions import shipped
from common.levels.level import Level
from common.levels.supply import LevelSupply
from common.rail.compiled.decisions import Decisions
from common.rail.compiled.world import CompiledWorld
from common.rail.observations.tree import TreeObservation
from common.rail.world import MOVE_FORWARD, N_ACTIONS
from common.seeding import training_level_seed
from common.strict import nearest

Observation = NDArray[np.float32]
Infos = dict[str, dict[str, Any]]
Actions = Mapping[str, int | np.int64]
SEED_BITS = 31


def _mask(actions: range) -> NDArray[np.int8]:
    mask = np.zeros(N_ACTIONS, np.int8)
    mask[actions] = 1
    mask.flags.writeable = False
    return mask


ALL_ACTIONS, FORWARD_ONLY = _mask(range(N_ACTIONS)), _mask(range(MOVE_FORWARD, MOVE_FORWARD + 1))


class TrainsEnv(ParallelEnv[str, Observation, np.int64]):
    """Agents `train_0`, `train_1`, ...; one that has arrived terminates, the step limit truncates the others.

    After `reset(seed=s)` an episode is on the level on which the first episode of a run of seed s trains, if the run
    is of this difficulty; each `reset()` then goes on to the next. A seed is drawn if none was ever given.

    Attributes:
        level: the one that is being played.
    """

    metadata = {"name": "railctl_trains_v0", "render_modes": []}  # noqa: RUF012  (the interface's own form)
    render_mode = None

    def __init__(
        self,
        difficulty: str = "easy",
        *,
        depth: int = 2,
        decisions: Decisions = "cells",
        levels: LevelSupply | None = None,
    ) -> None:
        """Make an environment; it starts with `reset`.

        Args:
            difficulty: of the levels, unless `reset` asks for another; there can be no more trains than in this one.
            depth: of the trees, 1 to 3: 60, 252 or 1020 features.
            decisions: where trains decide, `cells`, `legacy` or `always`; see `common.rail.compiled.decisions`.
            levels: where they come from; the generator if not given.

        Raises:
            ValueError: an argument is none of these.
        """
        if decisions not in get_args(Decisions):
            raise ValueError(f"unknown decisions {decisions}{nearest(decisions, list(get_args(Decisions)))}")
        self.difficulty = _known(difficulty)
        self.possible_agents = [f"train_{train}" for train in range(shipped()[difficulty].trains)]
        self.agents: list[str] = []
        self.level: Level | None = None
        observation = TreeObservation(depth=depth)
        self._world = CompiledWorld(1, len(self.possible_agents), decisions=decisions, observation=observation)
        self._levels = LevelSupply() if levels is None else levels
        self._numbers = {agent: train for train, agent in enumerate(self.possible_agents)}
        self.observation_spaces = {agent: self._box() for agent in self.possible_agents}
        self.action_spaces = {agent: Discrete(N_ACTIONS) for agent in self.possible_agents}
        self._seed: int | None = None
        self._episode = 0

    def observation_space(self, agent: str) -> Space[Observation]:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[np.int64]:
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], Infos]:
        """Start an episode.

        Args:
            seed: see the class.
            options: `difficulty`, of this level, or `level`, to be played instead of a drawn one. Others are left to
                wrappers.

        Returns:
            Observations and infos of all agents.

        Raises:
            ValueError: the level has more trains than there can be agents.
        """
        if seed is not None:
            self._seed, self._episode = seed, 0
        elif self._seed is None:
            self._seed = secrets.randbits(SEED_BITS)
        else:
            self._episode += 1
        self.level = self._drawn(self._seed, options or {})
        if self.level.n_trains > len(self.possible_agents):
            raise ValueError(
                f"a level with {self.level.n_trains} trains, but an environment for {len(self.possible_agents)}: "
                "make it for a higher difficulty"
            )
        self._world.load(0, self.level)
        self.agents = self.possible_agents[: self.level.n_trains]
        return self._observations(self._world.arrived()[0]), self._infos(0.0)

    def step(
        self, actions: Actions
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """One step of all trains.

        Args:
            actions: of the agents; those that do not decide may be left out.

        Returns:
            Observations, rewards, terminations, truncations and infos of those that were agents before the step. An
            arrived train sees nothing: zeros.

        Raises:
            ResetNeeded: the episode is over, or there was none.
            ValueError: an action is none, or that of a train that decides is missing.
        """
        if not self.agents:
            raise ResetNeeded("there is no episode to step: call reset first")
        rewards = self._world.step(self._given(actions))[0]
        arrived, over = self._world.arrived()[0], bool(self._world.over()[0])
        before = self.agents
        observations, infos = self._observations(arrived), self._infos(float(rewards.sum()))
        terminated = {agent: bool(arrived[self._numbers[agent]]) for agent in before}
        truncated = {agent: over and not terminated[agent] for agent in before}
        self.agents = [agent for agent in before if not (terminated[agent] or truncated[agent])]
        given = {agent: float(rewards[self._numbers[agent]]) for agent in before}
        return observations, given, terminated, truncated, infos

    def close(self) -> None:
        """Nothing is held."""

    def _box(self) -> Space[Any]:
        return Box(-1, 0, (self._world.n_features,), np.float32)

    def _drawn(self, seed: int, options: dict[str, Any]) -> Level:
        level = options.get("level")
        if isinstance(level, Level):
            return level
        difficulty = _known(options.get("difficulty", self.difficulty))
        return self._levels.training(difficulty, training_level_seed(seed, self._episode))

    def _given(self, actions: Actions) -> NDArray[np.int8]:
        """[1, N]: the actions of all trains."""
        given = np.full((1, len(self.possible_agents)), MOVE_FORWARD, np.int8)
        deciding = self._world.deciding()[0]
        for agent in self.agents:
            train = self._numbers[agent]
            action = actions.get(agent)
            if action is None:
                if deciding[train]:
                    raise ValueError(f"{agent} decides, and there is no action for it")
            elif not 0 <= int(action) < N_ACTIONS:
                raise ValueError(f"{agent} has action {action}: choose 0 to {N_ACTIONS - 1}")
            else:
                given[0, train] = action
        return given

    def _observations(self, arrived: NDArray[np.bool_]) -> dict[str, Observation]:
        return {
            agent: np.zeros(self._world.n_features, np.float32) if arrived[train] else self._world.observe(0, train)
            for agent, train in ((agent, self._numbers[agent]) for agent in self.agents)
        }

    def _infos(self, team_reward: float) -> Infos:
        deciding = self._world.deciding()[0]
        infos: Infos = {}
        for agent in self.agents:
            decides = bool(deciding[self._numbers[agent]])
            mask = ALL_ACTIONS if decides else FORWARD_ONLY
            infos[agent] = {"deciding": decides, "action_mask": mask, "team_reward": team_reward}
        return infos


def _known(difficulty: Any) -> str:
    if difficulty not in list(shipped()):
        raise ValueError(f"unknown difficulty {difficulty}{nearest(str(difficulty), list(list(shipped())))}")
    return difficulty  # type: ignore[no-any-return]
