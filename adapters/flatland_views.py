"""What trains of a `RailEnv` of flatland-rl 4.3.0 see and may decide in the world of a checkpoint.

Observations come from the code that `common.rail.flatland_world` takes them from, which equals the compiled world.
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import click
import numpy as np
from flatland.core.env_observation_builder import ObservationBuilder
from flatland.envs.rail_env import RailEnv
from flatland.envs.step_utils.states import TrainState
from numpy.typing import NDArray

from railctl.common.levels.distributions import Rules
from railctl.common.levels.level import Level
from railctl.common.rail.asking import Asking, Free
from railctl.common.rail.compiled.world import STUDY_REWARD
from railctl.common.rail.decisions import decision_cells
from railctl.common.rail.flatland_env import has_way
from railctl.common.rail.flatland_sights import FlatlandSight, sight_of
from railctl.common.rail.flatland_world import decides
from railctl.common.rail.from_flatland import UnsupportedEnvironmentError, level_of, schedule_of
from railctl.common.rail.mirror import Mirror
from railctl.common.rail.world import MOVE_FORWARD, N_ACTIONS
from railctl.common.world import WorldSpec

Place = tuple[int, int, int]  # row, column, heading


@dataclass(frozen=True)
class TrainView:
    """All that a policy is told of a train.

    Attributes:
        step: steps so far.
        place: where the train is; None off the map.
        deciding: it is for the policy to say what happens now, unless the train is committed to what was said before.
        broken: nothing can be said to it now.
        ways: [5], whether the rails let an action be taken.
        vector: [F], the world's observation; zeros if it is not deciding.
        signals: what all trains of the environment ask for their actions.
    """

    step: int
    place: Place | None
    deciding: bool
    broken: bool
    ways: tuple[bool, ...]
    vector: NDArray[np.float32]
    signals: "Signals"


class Signals(Protocol):
    """The interlocking of an environment, or none: then everybody may do anything."""

    def ask(self, deciding: NDArray[np.bool_]) -> Asking:
        """Begin to ask the trains of which `deciding` [N] holds, one after another."""

    def unasked(self) -> list[int]:
        """[N]: what trains do that are not asked."""

    def note(self, actions: list[int], deciding: NDArray[np.bool_]) -> None:
        """What trains do in this step [N], and which of them were asked [N]."""


class WorldObservation(ObservationBuilder[RailEnv, TrainView]):
    """What trains see in a world."""

    def __init__(self, world: WorldSpec, rules: Rules) -> None:
        """An observation builder.

        Args:
            world: says what trains see, and where they decide.
            rules: those that the policy has learned under; `legacy` shows the library's trains as those of 2.2.2.
        """
        super().__init__()  # type: ignore[no-untyped-call]
        self.world, self.rules = world, rules
        self._rails: _Rails | None = None
        self._nothing = np.zeros(world.n_features, np.float32)

    def reset(self, env: RailEnv) -> None:
        """Take another environment, or another level of it."""
        super().reset(env)
        self._rails = None  # not before somebody looks: the tools reset environments that are still without trains

    def get(self, handle: int = 0) -> TrainView:
        return self.get_many([handle])[handle]

    def get_many(self, handles: list[int] | None = None) -> dict[int, TrainView]:
        """What these trains are told.

        Raises:
            click.ClickException: the environment does something that the world does not know, or is too large.
        """
        env: Any = self.env
        if self._rails is None:
            self._rails = _Rails(env, self.world, self.rules)
        self._rails.update()
        return {handle: self._view(env, self._rails, handle) for handle in handles or []}

    def _view(self, env: Any, rails: "_Rails", handle: int) -> TrainView:
        agent = env.agents[handle]
        here = agent.current_configuration
        deciding = rails.decides(agent)
        return TrainView(
            step=int(env._elapsed_steps),  # noqa: SLF001  (there is no other way to ask)
            place=None if here is None else (int(here[0][0]), int(here[0][1]), int(here[1])),
            deciding=deciding,
            broken=bool(agent.malfunction_handler.in_malfunction),
            ways=tuple(here is not None and has_way(env.rail, here, action) for action in range(N_ACTIONS)),
            vector=rails.sight.observe(handle) if deciding else self._nothing,
            signals=rails,
        )


class _Rails:
    """The level of an environment: where trains decide, what they see, and what they are allowed."""

    def __init__(self, env: RailEnv, world: WorldSpec, rules: Rules) -> None:
        try:
            self._level = _level_of(env, rules)
            _check_size(self._level, world)
            self._mirror = None if world.interlocking == "off" else _mirror(env, self._level, world, rules)
            self.sight = _sight(env, self._level, world, rules, self._mirror)
        except (UnsupportedEnvironmentError, ValueError) as error:
            raise click.ClickException(f"this environment is not supported: {error}") from None
        self._cells = decision_cells(self._level.grid)
        self._decisions, self._rules = world.decisions, rules
        self._n_trains = self._level.n_trains
        self._noted: tuple[list[int], NDArray[np.bool_]] | None = None

    def update(self) -> None:
        """Take over what has become of the environment."""
        self.sight.update()
        if self._mirror is None:
            return
        if self._mirror is not self.sight:
            self._mirror.update()
        if self._noted is not None and self._rules == "stock":
            self._mirror.bind(*self._noted)
        self._noted = None

    def ask(self, deciding: NDArray[np.bool_]) -> Asking:
        return Free(deciding) if self._mirror is None else self._mirror.ask(deciding)

    def unasked(self) -> list[int]:
        return [MOVE_FORWARD] * self._n_trains if self._mirror is None else self._mirror.unasked()

    def note(self, actions: list[int], deciding: NDArray[np.bool_]) -> None:
        self._noted = actions, deciding

    def decides(self, agent: Any) -> bool:
        """Whether a train decides that is not committed."""
        here = agent.current_configuration
        if self._rules == "stock" or here is None:
            return decides(agent, self._decisions, self._cells)
        (row, column), heading = here  # slow trains decide when they come in, for they are committed from then on
        may = self._decisions != "cells" or self._cells[row, column, int(heading)]
        return bool(may) and agent.state != TrainState.DONE and not agent.malfunction_handler.in_malfunction


def _level_of(env: RailEnv, rules: Rules) -> Level:
    """With what trains see of schedules; the rules of 2.2.2 know none."""
    level = level_of(env, with_schedule=False)
    return level if rules == "legacy" else replace(level, schedule=schedule_of(env, None))


def _check_size(level: Level, world: WorldSpec) -> None:
    """Refuse a level that an observation as large as a level has no room for."""
    (height, width), bounds = level.grid.shape, world.bounds
    largest = bounds._replace(height=max(height, bounds.height), width=max(width, bounds.width))
    if world.observation.n_features(largest) != world.n_features:
        raise ValueError(
            f"its grid is {height}x{width}, and the checkpoint's {world.observation.kind} observation has room for "
            f"{bounds.height}x{bounds.width}: use levels of that size"
        )


def _sight(env: RailEnv, level: Level, world: WorldSpec, rules: Rules, mirror: Mirror | None) -> FlatlandSight:
    sight = sight_of(world.observation, rules, world.bounds, env, level)
    if sight is not None:
        return sight
    return _mirror(env, level, world, rules) if mirror is None else mirror


def _mirror(env: RailEnv, level: Level, world: WorldSpec, rules: Rules) -> Mirror:
    told = world.observation, rules, world.bounds, world.decisions, STUDY_REWARD
    return Mirror(env, level, *told, world.interlocking, world.patience)
