"""A compiled world that repeats what an environment of flatland-rl shows, for what the library itself cannot do."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from flatland.envs.rail_env import RailEnv
from flatland.envs.step_utils.states import TrainState
from numpy.typing import NDArray

from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.levels.level import Level
from railctl.common.rail.asking import Asking, asking_of, unasked
from railctl.common.rail.compiled.arrays import IS_OCCUPIED, NOTHING, NOWHERE
from railctl.common.rail.compiled.batches import bind
from railctl.common.rail.compiled.decisions import Decisions
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.flatland_env import LegacyActions
from railctl.common.rail.interlocking.signals import Interlocking
from railctl.common.rail.observations.table import AnyObservation, header_of, look
from railctl.common.rail.planning.judging import Teacher
from railctl.common.rail.rewards.table import AnyReward, pay

STANDING = (TrainState.READY_TO_DEPART, TrainState.STOPPED, TrainState.MALFUNCTION, TrainState.MALFUNCTION_OFF_MAP)


class Mirror:
    """The state of one environment in the arrays of a compiled world; to be updated after the start and every step."""

    def __init__(  # noqa: PLR0913
        self,
        env: RailEnv,
        level: Level,
        observation: AnyObservation,
        rules: Rules,
        bounds: Bounds | None,
        decisions: Decisions,
        reward: AnyReward,
        interlocking: Interlocking = "off",
        patience: int | None = None,
        actions: LegacyActions | None = None,
    ) -> None:
        """Show an environment that was just loaded with a level; `actions` know which trains are committed."""
        self._env: Any = env
        self._actions = actions
        self._observation = header_of(observation, rules, bounds, decisions)
        self._n_features = observation.n_features(bounds)
        asked: dict[str, Any] = {"decisions": decisions, "interlocking": interlocking, "patience": patience}
        self._world = CompiledWorld(1, level.n_trains, rules=rules, reward=reward, **asked)
        self._world.load(0, level)
        cells = self._world.batch.cells[0, : self._world.batch.worlds[0]["cells"]]
        places = zip(cells["row"].tolist(), cells["column"].tolist(), strict=True)
        self._numbers = {place: number for number, place in enumerate(places)}

    def update(self) -> None:
        """Take over what has become of the environment, which plays the level."""
        env, agents = self._env, self._env.agents
        world: Any = self._world.batch.worlds[0]
        passed = env._elapsed_steps - int(world["time"])  # noqa: SLF001  (there is no other way to ask)
        world["time"] += passed
        world["over"] = env.dones["__all__"]
        world["all_arrived"] = all(agent.state == TrainState.DONE for agent in agents)
        cells, codes = self._world.batch.cells[0], self._world.batch.codes[0]
        cells["train"], cells["waiting"] = NOTHING, 0
        codes &= ~IS_OCCUPIED
        for at, agent in enumerate(agents):
            train = self._world.batch.trains[0, at]
            self._copy_train(train, agent, int(world["unit"]))
            if self._actions is not None:
                driver = self._actions.drivers[at]
                train["committed"] = NOTHING if driver.committed is None else driver.committed
                train["driving"] = driver.moving
            train["stood"] = train["stood"] + passed if agent.state in STANDING else 0
            if train["config"] != NOWHERE:
                cell = int(train["config"]) >> 2
                cells[cell]["train"] = at
                codes[cell * 4 : cell * 4 + 4] |= IS_OCCUPIED
            elif agent.state.is_off_map_state():
                cells[int(train["start"]) >> 2]["waiting"] += 1

    def observe(self, train: int) -> NDArray[np.float32]:
        """[F]: what a train sees."""
        parts = self._world.parts()
        asking = np.zeros_like(parts.deciding)
        asking[0, train] = True
        vectors = np.empty((1, self._n_features), np.float32)
        look(parts.batch, parts.sight, self._observation, asking, vectors)
        vector: NDArray[np.float32] = vectors[0]
        return vector

    def rewards(self) -> NDArray[np.float32]:
        """[N]: what trains are paid for the last step; to be asked once a step."""
        parts = self._world.parts()
        rewards = np.zeros(self._world.max_trains, np.float32)
        pay(parts.batch, 0, rewards, parts.reward)
        return rewards

    def bind(self, actions: Sequence[int], deciding: NDArray[np.bool_]) -> None:
        """Note who was hindered in a step, once it is taken over; `deciding` [N] are those that decided before it."""
        trains = self._world.batch.trains[0]
        trains["action"] = actions
        bind(trains, deciding)

    def ask(self, deciding: NDArray[np.bool_]) -> Asking:
        """As `World.ask`, of the trains of which `deciding` [N] holds."""
        parts = self._world.parts()
        return asking_of(parts.batch, 0, parts.interlocking, parts.decisions, parts.signals, deciding)

    def advise(self, train: int, allowed: int, teacher: Teacher) -> int:
        """As `World.advise`."""
        return self._world.advise(0, train, allowed, teacher)

    def allowed(self) -> NDArray[np.uint8]:
        """[N], as `World.allowed`."""
        return self._world.allowed(0)

    def unasked(self) -> list[int]:
        """[N]: what the trains are told that do not decide; see `common.rail.asking.unasked`."""
        batch, mode = self._world.batch, self._world.parts().interlocking
        return [int(unasked(batch.codes[0], here, mode)) for here in batch.trains[0]["config"].tolist()]

    def _copy_train(self, train: np.void, agent: Any, unit: int) -> None:
        train["state"] = int(agent.state)
        train["config"] = self._configuration(agent.current_configuration)
        train["before"] = self._configuration(agent.old_configuration)
        train["finish"] = self._configuration(agent.target_configuration)
        train["speed"] = int(agent.speed_counter.speed * unit)
        train["distance"] = int(agent.speed_counter.distance * unit)
        train["malfunction"] = agent.malfunction_handler.malfunction_down_counter
        train["arrived_at"] = NOTHING if agent.arrival_time is None else agent.arrival_time

    def _configuration(self, place: Any) -> int:
        return NOWHERE if place is None else self._numbers[place[0]] * 4 + int(place[1])
