"""Flatland-rl 4.3.0 as the judge: random environments, and everything that it knows of them as plain values."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs import observations
from flatland.envs.line_generators import sparse_line_generator
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.observations import TreeObsForRailEnv
from flatland.envs.predictions import ShortestPathPredictorForRailEnv
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_generators import sparse_rail_generator
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.envs.step_utils.states import TrainState
from flatland.envs.timetable_generators import timetable_generator
from flatland.envs.timetable_utils import Timetable

from railctl.common.rail.compiled.malfunctions import MalfunctionGenerators, words_of
from railctl.common.rail.compiled.tree import nodes_of
from railctl.common.rail.library_tree import flatten

SPEEDS = (
    None,
    {1.0: 0.25, 0.5: 0.25, 0.33: 0.25, 0.25: 0.25},
    {1.0: 0.4, 0.4: 0.2, 0.7: 0.2, 0.2: 0.2},  # fractions that are no inverses of integers, too
)
TALLEST = 1000
ACTION_MIXES = ([0.05, 0.1, 0.7, 0.1, 0.05], [0.2] * 5, [0.02, 0.18, 0.6, 0.18, 0.02])


def no_timetable(agents: list[Any], distance_map: Any, _hints: Any, np_random: Any = None) -> Timetable:
    """Every train may depart at once."""
    limit = int(4 * 2 * (distance_map.rail.width + distance_map.rail.height + len(agents) / 2))
    return Timetable([[0, None]] * len(agents), [[None, limit]] * len(agents), limit)


def random_env(rng: np.random.RandomState, most_trains: int = 50) -> RailEnv:
    """A new environment of any kind that the compiled world knows, reset."""
    while True:
        env = _drawn_env(rng, most_trains)
        try:
            env.reset()
        except ValueError as error:
            if "Cannot fit more than one city" not in str(error):
                raise
        else:
            return env


def _drawn_env(rng: np.random.RandomState, most_trains: int) -> RailEnv:
    side = int(rng.choice([20, 25, 30, 40, 60], p=[0.2, 0.35, 0.2, 0.15, 0.1]))
    trains = int(np.ceil(most_trains * rng.rand() ** 2.5)) if side > 25 else int(rng.randint(1, min(most_trains, 14)))
    breaks = rng.rand() < 0.5
    return RailEnv(
        side,
        side + int(rng.randint(0, 6)),
        rail_generator=sparse_rail_generator(
            max_num_cities=int(rng.randint(2, 3 + side // 15)),
            grid_mode=bool(rng.rand() < 0.2),
            max_rails_between_cities=int(rng.randint(1, 3)),
            max_rail_pairs_in_city=int(rng.randint(1, 3)),
        ),
        line_generator=sparse_line_generator(SPEEDS[rng.randint(3)]),
        number_of_agents=trains,
        obs_builder_object=DummyObservationBuilder(),
        timetable_generator=timetable_generator if rng.rand() < 0.5 else no_timetable,
        malfunction_generator=ParamMalfunctionGen(
            MalfunctionParameters(float(rng.choice([1 / 20, 1 / 60, 1 / 200])), 2, int(rng.randint(2, 12)))
        )
        if breaks
        else None,
        random_seed=int(rng.randint(1 << 30)),
    )


def forget() -> None:
    """Empty the library's caches, which keep every map."""
    for owner in RailGridTransitionMap.__mro__:
        for member in vars(owner).values():
            if hasattr(member, "cache_clear"):
                member.cache_clear()


def trains_of(env: RailEnv) -> list[tuple[Any, ...]]:
    """State, configuration, speed, distance, malfunction, done, required, arrival of every train."""
    info = env.get_info_dict()
    return [
        (
            int(agent.state),
            None
            if agent.current_configuration is None
            else (*agent.current_configuration[0], int(agent.current_configuration[1])),
            agent.speed_counter.speed,
            agent.speed_counter.distance,
            info["malfunction"][i],
            bool(env.dones[i]),
            bool(info["action_required"][i]),
            agent.arrival_time,
        )
        for i, agent in enumerate(env.agents)
    ]


def generators_of(env: RailEnv) -> MalfunctionGenerators:
    """Where the environment stands with its malfunctions; nothing is drawn."""
    generator = env.effects_generator.malfunction_generator
    now = words_of(env.np_random)
    if generator._cached_rand is None:
        return MalfunctionGenerators(now)
    before = np.random.RandomState()
    before.set_state(generator._cached_random_state)
    return MalfunctionGenerators(words_of(before), generator._rand_idx, now)


class TreeOracle:
    """The library's trees of an environment: as they are, and with conflicts found, as 4.3.0 or as 2.2.2 sees them."""

    def __init__(self, env: RailEnv, depth: int, predicted_steps: int) -> None:
        self._env, self._depth = env, depth
        self._stock = TreeObsForRailEnv(depth)
        self._stock_predicting = TreeObsForRailEnv(depth, ShortestPathPredictorForRailEnv(predicted_steps))
        self._repaired = TreeObsForRailEnv(depth, ShortestPathPredictorForRailEnv(predicted_steps))
        self._legacy = TreeObsForRailEnv(depth, _LegacyPredictor(predicted_steps))
        for builder in (self._stock, self._stock_predicting, self._repaired, self._legacy):
            builder.reset(env)

    def stock(self, *, predicting: bool = False) -> np.ndarray:
        """[N, nodes, 12]; the predictor changes nothing in 4.3.0."""
        return self._look(self._stock_predicting if predicting else self._stock)

    def repaired(self) -> np.ndarray:
        with _conflicts_found():
            return self._look(self._repaired)

    def legacy(self) -> np.ndarray:
        agents = self._env.agents
        speeds = [agent.speed_counter._speed for agent in agents]
        for agent in agents:
            agent.speed_counter._speed = agent.speed_counter.max_speed
        with _conflicts_found():
            trees = self._look(self._legacy)
        for agent, speed in zip(agents, speeds, strict=True):
            agent.speed_counter._speed = speed
        trees[[agent.state == TrainState.DONE for agent in agents]] = np.nan
        return trees

    def _look(self, builder: TreeObsForRailEnv) -> np.ndarray:
        handles = list(range(len(self._env.agents)))
        found = builder.get_many(handles)
        trees = np.full((len(handles), nodes_of(self._depth), 12), np.nan, np.float32)
        for handle in handles:
            if found[handle] is not None:
                flatten(found[handle], trees[handle])
        return trees


class _LegacyPredictor(ShortestPathPredictorForRailEnv):
    """Trains that have arrived are nowhere, as in 2.2.2."""

    def get(self, handle: int | None = None) -> Any:
        predictions = super().get(handle)
        for agent in self.env.agents:
            if agent.state == TrainState.DONE:
                predictions[agent.handle][:, 1:] = np.nan
        return predictions


def _positions(_width: int, coordinates: Any) -> np.ndarray:
    """What `coordinate_to_position` returned before it became a list, which equals no position.

    The library multiplies by the width, which confuses cells of a grid that is taller than wide.
    """
    return np.array([-1 if np.isnan(row) else int(column * TALLEST + row) for row, column in coordinates], dtype=int)


@contextmanager
def _conflicts_found() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observations, "coordinate_to_position", _positions)
        patch.setattr(observations, "fast_delete", np.delete)
        yield
