"""The world of the study on flatland-rl 4.3.0: the library steps, under the rules of 2.2.2.

Source: `RailEnv.step` of flatland-rl 2.2.2, and of 4.3.0, whose differences are made up for here: trains start ready to
depart, a blocked train stays committed to its action, a train that stands stays so on DO_NOTHING, and a reward is -1 a
step until arrival, with 1 for all on the step that the last train arrives. Speeds are 1, nothing breaks down.
"""

import random
from collections.abc import Sequence
from functools import lru_cache
from types import MethodType
from typing import Any

import numpy as np
from flatland.core.effects_generator import EffectsGenerator
from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.core.grid.grid4 import Grid4TransitionsEnum
from flatland.envs.grid.rail_env_grid import RailEnvTransitions
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_env_action import RailEnvActions
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.envs.rail_trainrun_data_structures import Waypoint
from flatland.envs.rewards import Rewards
from flatland.envs.step_utils.states import TrainState
from flatland.envs.timetable_utils import Line, Timetable
from numpy.typing import NDArray

from common.levels.level import Level
from common.rail.decisions import decision_cells
from common.rail.legacy_tree import LegacyTree
from common.rail.normalise import N_FEATURES, normalise
from common.rail.world import DO_NOTHING, MOVE_FORWARD, STOP_MOVING

ACTIONS = [RailEnvActions.from_value(action) for action in range(5)]
_TRANSITIONS = RailEnvTransitions()


class StudyRewards(Rewards[float]):
    """-1 a step until arrival, 0 on arrival and after; 1 more for all on the step that the last train arrives."""

    def step_reward(self, agent: Any, agent_transition_data: Any, distance_map: Any, elapsed_steps: int) -> float:  # noqa: ARG002
        return 0.0 if agent.state == TrainState.DONE else -1.0

    def end_of_episode_reward(self, agent: Any, distance_map: Any, elapsed_steps: int) -> float:  # noqa: ARG002
        return 1.0 if all(other.state == TrainState.DONE for other in distance_map.agents) else 0.0

    def cumulate(self, *rewards: float) -> float:
        return sum(rewards)

    def empty(self) -> float:
        return 0.0


class StartReady(EffectsGenerator[RailEnv]):
    """4.3.0 spends the first step on becoming ready to depart; 2.2.2 starts so. No malfunctions either."""

    def on_episode_start(self, env: RailEnv, *_args: Any, **_kwargs: Any) -> RailEnv:
        for agent in env.agents:
            agent.state_machine.set_state(TrainState.READY_TO_DEPART)
        return env


class _LevelRail(RailGridTransitionMap):
    """The rails of a level, with caches that go when it goes.

    The library's are shared by all maps, and keep every map that they ever saw.
    """

    def __init__(self, level: Level) -> None:
        height, width = level.grid.shape
        super().__init__(width, height, _TRANSITIONS, grid=level.grid.copy())
        for owner in reversed(RailGridTransitionMap.__mro__):
            for name, member in vars(owner).items():
                if hasattr(member, "cache_clear"):
                    setattr(self, name, lru_cache(maxsize=None)(MethodType(member.__wrapped__, self)))


class _LevelEnv(RailEnv):
    """A `RailEnv` whose rails, line and timetable are those of `level` at the time of `reset`."""

    def __init__(self, level: Level) -> None:
        self.level = level
        height, width = level.grid.shape
        state = random.getstate()  # the library seeds the interpreter's own generator
        super().__init__(
            width,
            height,
            rail_generator=lambda *_args: (_LevelRail(self.level), None),
            line_generator=lambda *_args: _line(self.level, self.rail),
            timetable_generator=lambda *_args: _timetable(self.level),
            obs_builder_object=DummyObservationBuilder(),
            rewards=StudyRewards(),
            random_seed=0,
        )
        random.setstate(state)
        self.effects_generator = StartReady()

    def get_info_dict(self) -> dict[str, Any]:
        """Nobody asks, and it takes as long as a third of a step."""
        return {}


def _line(level: Level, rail: RailGridTransitionMap) -> Line:
    waypoints = {}
    for train, ((row, column, heading), target) in enumerate(
        zip(level.starts.tolist(), map(tuple, level.targets.tolist()), strict=True)
    ):
        ends = [Waypoint(target, facing) for facing in Grid4TransitionsEnum if rail.is_valid_configuration((target, facing))]
        waypoints[train] = [[Waypoint((row, column), Grid4TransitionsEnum(heading))], ends]
    return Line(agent_waypoints=waypoints, agent_speeds=[1.0] * level.n_trains)


def _timetable(level: Level) -> Timetable:
    """No time windows: every train may depart at once and has until the step limit."""
    return Timetable(
        earliest_departures=[[0, None]] * level.n_trains,
        latest_arrivals=[[None, level.max_steps]] * level.n_trains,
        max_episode_steps=level.max_steps,
    )


class LegacyActions:
    """What a train of 2.2.2 does, said to 4.3.0 (speed 1, no malfunctions).

    A train that tried to move and was blocked stays `committed` to its action until it moves. A train that is
    not `moving` (just departed, stopped, or facing a switch without a way) stays so on DO_NOTHING; otherwise
    DO_NOTHING drives on.
    """

    def __init__(self, env: RailEnv) -> None:
        self._env = env
        self.committed: list[int | None] = [None] * len(env.agents)
        self._moving = [False] * len(env.agents)

    def step(self, actions: Sequence[int]) -> None:
        """Step the env with an action a train."""
        agents = self._env.agents
        before = [agent.current_configuration for agent in agents]
        sent = [self._translate(agent.handle, here, action) for agent, here, action in zip(agents, before, actions, strict=True)]
        self._env.step({train: ACTIONS[action] for train, action in enumerate(sent)})
        for train, here in enumerate(before):
            blocked = here is not None and self._moving[train] and agents[train].current_configuration == here
            self.committed[train] = sent[train] if blocked else None

    def _translate(self, train: int, here: Any, action: int) -> int:
        if here is None:  # off the map 4.3.0 does as 2.2.2 did
            self._moving[train] = False
            return action
        committed = self.committed[train]
        if committed is not None:
            action = committed
        elif action == DO_NOTHING:
            action = MOVE_FORWARD if self._moving[train] else STOP_MOVING
        has_way = self._env.rail.apply_action_independent(ACTIONS[action], here) is not None
        self._moving[train] = action != STOP_MOVING and has_way
        return action


class FlatlandEpisode:
    """Episodes of one slot, one after the other: `load` a level, then `step` with an action a train."""

    def __init__(self, level: Level) -> None:
        self._env = _LevelEnv(level)
        self.load(level)

    def load(self, level: Level) -> None:
        self.level = level
        self._env.level = level
        self._env.reset()
        self._env.agent_positions = np.full(level.grid.shape, -1)  # the library never clears it
        self._actions = LegacyActions(self._env)
        self._tree = LegacyTree(level)
        self._tree_is_current = False
        self._cells = decision_cells(level.grid)
        self.over = False

    def step(self, actions: Sequence[int]) -> list[float]:
        """One step: the trains' rewards. A committed train follows its earlier action instead."""
        self._actions.step(actions)
        self._tree_is_current = False
        self.over = self._env.dones["__all__"]
        rewards = self._env.rewards_dict
        return [rewards[train] for train in range(self.level.n_trains)]

    def deciding(self) -> list[bool]:
        """Trains whose action matters: those ready to depart, and those on a decision cell that are not committed."""
        return [
            self._decides(agent, committed)
            for agent, committed in zip(self._env.agents, self._actions.committed, strict=True)
        ]

    def _decides(self, agent: Any, committed: int | None) -> bool:
        here = agent.current_configuration
        if here is None:
            return bool(agent.state == TrainState.READY_TO_DEPART)
        (row, column), heading = here
        return committed is None and bool(self._cells[row, column, heading])

    def arrived(self) -> list[bool]:
        return [agent.state == TrainState.DONE for agent in self._env.agents]

    def configurations(self) -> list[tuple[int, int, int] | None]:
        """Row, column and heading of the trains; None for those that are not on the map."""
        here = (agent.current_configuration for agent in self._env.agents)
        return [None if at is None else (*at[0], int(at[1])) for at in here]

    def committed(self) -> list[bool]:
        """Trains that try again what they were hindered from."""
        return [action is not None for action in self._actions.committed]

    def tree(self, train: int) -> NDArray[np.float32]:
        """[21, 12]: the raw tree observation of a train that has not arrived."""
        if not self._tree_is_current:
            self._update_tree()
        return self._tree.tree(train)

    def _update_tree(self) -> None:
        width = self._env.width
        places: list[int | None] = []
        for agent in self._env.agents:
            here = agent.current_configuration
            if here is None and agent.state != TrainState.DONE:
                here = agent.initial_configuration
            places.append(None if here is None else (here[0][0] * width + here[0][1]) * 4 + int(here[1]))
        self._tree.update(places, [agent.current_configuration is not None for agent in self._env.agents])
        self._tree_is_current = True


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
            raise ValueError(f"the level has {level.n_trains} trains, the world room for {self.max_trains}")
        episode = self._episodes[slot]
        if episode is None:
            episode = self._episodes[slot] = FlatlandEpisode(level)
        else:
            episode.load(level)
        self._deciding[slot] = self._arrived[slot] = False
        self._look(slot, episode)

    def _look(self, slot: int, episode: FlatlandEpisode) -> None:
        trains = episode.level.n_trains
        self._over[slot] = episode.over
        self._arrived[slot, :trains] = episode.arrived()
        self._deciding[slot, :trains] = False if episode.over else episode.deciding()

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
