"""A flatland-rl 4.3.0 environment whose level is given, and whose trains start as either set of rules says.

Source: `RailEnv` of flatland-rl 4.3.0 through its own extension points (generators, rewards, effects, subclasses).
Nobody asks for its observations and infos, and under the rules of 2.2.2 speeds and malfunctions are left out, too, for
speed.
"""

import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache, partial
from types import MethodType
from typing import Any

import numpy as np
from flatland.core.effects_generator import EffectsGenerator
from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs.malfunction_effects_generators import MalfunctionEffectsGenerator
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_env_action import RailEnvActions
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.envs.rewards import Rewards
from flatland.envs.step_utils.speed_counter import SpeedCounter
from flatland.envs.step_utils.states import TrainState

from railctl.common.levels.distributions import Rules
from railctl.common.levels.level import Level
from railctl.common.rail.plain_env import StartReady, line_of, timetable_of
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, STOP_MOVING

ACTIONS = [RailEnvActions.from_value(action) for action in range(5)]


class StudyRewards(Rewards[float]):
    """-1 a step until arrival, 0 from then on; 1 more for all on the step that the last train arrives."""

    def step_reward(self, agent: Any, *_args: Any, **_kwargs: Any) -> float:
        return 0.0 if agent.state == TrainState.DONE else -1.0

    def end_of_episode_reward(self, agent: Any, distance_map: Any, elapsed_steps: int) -> float:  # noqa: ARG002
        return 1.0 if all(other.state == TrainState.DONE for other in distance_map.agents) else 0.0

    def cumulate(self, *rewards: float) -> float:
        return sum(rewards)

    def empty(self) -> float:
        return 0.0

    def normalize(self, *rewards: float, num_agents: int, max_episode_steps: int) -> float:
        """The normalised return of the study; asked for by the library's tools, not by `RailEnv`."""
        return sum(rewards) / (num_agents * max_episode_steps)


class _UnitSpeed(SpeedCounter):
    """A train of speed 1 is always at the end of a cell; saying so spares the arithmetic of fractions."""

    def __init__(self) -> None:
        super().__init__(1)

    def step(self, speed: Fraction | None = None) -> None:
        if speed is not None:
            self._speed = speed

    def is_cell_exit(self, speed: Fraction) -> bool:
        return speed.numerator > 0


class _StartReady(StartReady):
    """With the faster counters of speed."""

    def on_episode_start(self, env: RailEnv, *_args: Any, **_kwargs: Any) -> RailEnv:
        agents: list[Any] = super().on_episode_start(env).agents
        for agent in agents:
            agent.speed_counter = _UnitSpeed()
        return env


class _LevelRail(RailGridTransitionMap):
    """The rails of a level, with caches that go when it goes.

    The library's caches are shared by all maps, and keep every map that they ever saw.
    """

    def __init__(self, level: Level) -> None:
        height, width = level.grid.shape
        super().__init__(width, height, grid=level.grid.copy())
        for owner in reversed(RailGridTransitionMap.__mro__):
            for name, member in vars(owner).items():
                if hasattr(member, "cache_clear"):
                    setattr(self, name, lru_cache(maxsize=None)(MethodType(member.__wrapped__, self)))


class LevelEnv(RailEnv):
    """A `RailEnv` that plays a `Level`; it may be loaded with another one, of any size, at any time.

    Every episode is that of a fresh environment whose generator is `numpy.random.RandomState(malfunction_seed)` when it
    takes its first step.
    """

    def __init__(
        self,
        level: Level,
        rules: Rules = "legacy",
        rewards: Callable[[], Rewards[float]] = StudyRewards,
        malfunction_seed: int = 0,
    ) -> None:
        self._level = level
        self._legacy = rules == "legacy"
        self._paying = rewards
        height, width = level.grid.shape
        state = random.getstate()
        super().__init__(
            width,
            height,
            rail_generator=lambda *_args: (_LevelRail(self._level), None),
            line_generator=lambda rail, *_args: line_of(self._level, rail),
            timetable_generator=lambda *_args: timetable_of(self._level),
            obs_builder_object=DummyObservationBuilder(),  # type: ignore[no-untyped-call]
            rewards=rewards(),
            random_seed=0,
            acceleration_delta=Fraction(1),  # the default, a float, is converted in every step
            braking_delta=Fraction(-1),
        )
        random.setstate(state)  # the library seeds the interpreter's own generator
        self.load(level, malfunction_seed)

    def load(self, level: Level, malfunction_seed: int = 0) -> None:
        """Start an episode of `level`."""
        self._level = level
        self.effects_generator: Any = self._effects()
        self.agent_positions = np.full(level.grid.shape, -1)  # the library makes it once and never clears it
        self.rewards: Any = self._paying()  # those of the library remember where trains were
        self.reset()
        self.np_random = np.random.RandomState(malfunction_seed)

    def _effects(self) -> Any:
        if self._legacy:
            return _StartReady()
        malfunctions = None if self._level.schedule is None else self._level.schedule.malfunctions
        if malfunctions is None:
            return EffectsGenerator()
        generator = ParamMalfunctionGen(MalfunctionParameters(*malfunctions))
        return MalfunctionEffectsGenerator(generator)  # type: ignore[no-untyped-call]

    def _agents_from_line(self, line: Any, rail: Any) -> list[Any]:  # type: ignore[override]
        """With the speeds and the headings at targets of the level's schedule."""
        agents: list[Any] = super()._agents_from_line(line, rail)
        schedule = self._level.schedule
        if schedule is not None:
            for agent, speed, headings in zip(agents, schedule.speeds.tolist(), schedule.target_headings, strict=True):
                agent.speed_counter = SpeedCounter(Fraction(*speed))  # type: ignore[arg-type]
                agent.targets = {end for end in agent.targets if not headings or headings >> int(end[1]) & 1}
        return agents

    def _apply_timetable_to_agents(self, agents: list[Any], timetable: Any) -> list[Any]:
        """With the windows of the level's schedule."""
        agents = super()._apply_timetable_to_agents(agents, timetable)
        schedule = self._level.schedule
        if schedule is not None:
            for train, agent in enumerate(agents):
                agent.earliest_departure = int(schedule.earliest_departures[train])
                agent.latest_arrival = int(schedule.latest_arrivals[train])
        return agents

    def get_info_dict(self) -> dict[str, Any]:
        """Nobody asks for it, and it would take a tenth of a step."""
        return {}


class LegacyDriver:
    """What a train of 2.2.2 does, said to 4.3.0 (speed 1, no malfunctions): `send`, let it happen, then `look`.

    A train that tried to move and was blocked stays `committed` to its action until it moves. A train that is
    not moving (just departed, stopped, or facing a switch without a way) stays so on DO_NOTHING; otherwise
    DO_NOTHING drives on.
    """

    def __init__(self) -> None:
        self.committed: int | None = None
        self.moving = False  # or tries to
        self._sent = DO_NOTHING
        self._before: Any = None

    def send(self, here: Any, action: int, has_way: Callable[[int], bool]) -> int:
        """The action of 4.3.0 that does what `action` did.

        Args:
            here: where the train is; None off the map, where 4.3.0 does as 2.2.2 did.
            action: what was decided; one that is committed follows its earlier action instead.
            has_way: whether the rails let an action be taken from here.
        """
        if self.committed is not None:
            action = self.committed
        elif here is not None and action == DO_NOTHING:
            action = MOVE_FORWARD if self.moving else STOP_MOVING
        self.moving = here is not None and action != STOP_MOVING and has_way(action)
        self._before, self._sent = here, action
        return action

    def look(self, here: Any) -> None:
        """Take over where the train has come to."""
        self.committed = self._sent if self.moving and here == self._before else None


class LegacyActions:
    """The drivers of all trains of an environment."""

    def __init__(self, env: LevelEnv) -> None:
        self._env: Any = env
        self.drivers = [LegacyDriver() for _ in env.agents]

    @property
    def committed(self) -> list[int | None]:
        """[N]: the actions that trains are committed to."""
        return [driver.committed for driver in self.drivers]

    def step(self, actions: Sequence[int]) -> dict[int, RailEnvActions]:
        """Step the environment with an action a train; returns what it was given."""
        agents = self._env.agents
        sent = {}
        for train, driver in enumerate(self.drivers):
            here = agents[train].current_configuration
            sent[train] = ACTIONS[driver.send(here, actions[train], partial(has_way, self._env.rail, here))]
        self._env.step(sent)
        for agent, driver in zip(agents, self.drivers, strict=True):
            driver.look(agent.current_configuration)
        return sent


def has_way(rail: Any, here: Any, action: int) -> bool:
    """Whether the rails let a train take an action from its cell and heading."""
    return rail.apply_action_independent(ACTIONS[action], here) is not None
