"""Checkpoints in the console commands of flatland-rl 4.3.0: a policy, its observation and the study's rewards.

`flatland-trajectory-generate-from-policy` makes objects of these classes without arguments; the environment variable
RAILCTL_CHECKPOINT names the checkpoint. Trains act greedily, where the `cells` rule has them decide.

The tools run the rules of 4.3.0, training those of 2.2.2. What the policy can make up for it does: it says its
actions as 2.2.2 understood them (a blocked train keeps to its action, see `LegacyDriver`) and sees the tree of
2.2.2. For trains of speed 1 that may depart at once and never break down this leaves one difference:

- A train spends the first step on becoming ready to depart: all happens one step later, within the same step
  limit, and every train pays for one step more.

And where a level has more than the study:

- Timetables are not looked at: trains depart as soon as they may, and hurry.
- Slow trains decide when they enter a cell and keep to it until they leave; nobody's speed is seen.
- Broken trains do not decide, and are seen as whole.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from flatland.core.env_observation_builder import ObservationBuilder
from flatland.core.policy import Policy
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_env_action import RailEnvActions
from flatland.envs.step_utils.states import TrainState
from numpy.typing import NDArray

from common.checkpoint import CheckpointError
from common.policy.checkpoints import load_policy
from common.rail.decisions import decision_cells
from common.rail.flatland_env import ACTIONS, LegacyDriver, StudyRewards, has_way
from common.rail.from_flatland import UnsupportedEnvironmentError, level_of
from common.rail.legacy_tree import LegacyTree
from common.rail.normalise import N_FEATURES, normalise
from common.rail.play import Choose, Decision
from common.rail.world import DO_NOTHING, MOVE_FORWARD, N_ACTIONS

__all__ = ["CheckpointPolicy", "StudyObservation", "StudyRewards", "TrainView"]

VARIABLE = "RAILCTL_CHECKPOINT"
Place = tuple[int, int, int]  # row, column, heading
NOTHING: NDArray[np.float32] = np.zeros(N_FEATURES, np.float32)


@dataclass(frozen=True)
class TrainView:
    """All that a policy is told of a train.

    Attributes:
        step: steps so far.
        place: where the train is; None off the map.
        deciding: it is for the policy to say what happens now, unless the train is committed to what was said before.
        broken: nothing can be said to it now.
        ways: [5], whether the rails let an action be taken.
        vector: [252], the observation of `common.rail.normalise`; zeros if it is not deciding.
    """

    step: int
    place: Place | None
    deciding: bool
    broken: bool
    ways: tuple[bool, ...]
    vector: NDArray[np.float32]


class StudyObservation(ObservationBuilder[RailEnv, TrainView]):
    """What trains see under the study's conditions, out of a `RailEnv` of 4.3.0."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._rails: _Rails | None = None

    def reset(self, env: RailEnv) -> None:
        """Take another environment, or another level of it."""
        super().reset(env)
        self._rails = None  # not before somebody looks: the tools reset environments that are still without trains

    def get(self, handle: int = 0) -> TrainView:
        return self.get_many([handle])[handle]

    def get_many(self, handles: list[int] | None = None) -> dict[int, TrainView]:
        """What these trains are told.

        Raises:
            click.ClickException: the environment does something that the study's tree does not know.
        """
        env: Any = self.env
        if self._rails is None:
            self._rails = _Rails(env)
        places = [_place(agent.current_configuration) for agent in env.agents]
        self._rails.look(env.agents, places)
        return {handle: self._view(env, self._rails, handle, places[handle]) for handle in handles or []}

    def _view(self, env: Any, rails: "_Rails", handle: int, place: Place | None) -> TrainView:
        agent = env.agents[handle]
        broken = bool(agent.malfunction_handler.in_malfunction)
        ready = agent.state == TrainState.READY_TO_DEPART
        deciding = ready or (place is not None and not broken and bool(rails.cells[place]))
        here = agent.current_configuration
        return TrainView(
            step=int(env._elapsed_steps),  # noqa: SLF001  (there is no other way to ask)
            place=place,
            deciding=deciding,
            broken=broken,
            ways=tuple(here is not None and has_way(env.rail, here, action) for action in range(N_ACTIONS)),
            vector=normalise(rails.tree.tree(handle)) if deciding else NOTHING,
        )


class _Rails:
    """What the rails of a level say: where trains decide, and what they see."""

    def __init__(self, env: RailEnv) -> None:
        try:
            level = level_of(env, with_schedule=False)
        except UnsupportedEnvironmentError as error:
            raise click.ClickException(f"this environment is not supported: {error}") from None
        self.cells = decision_cells(level.grid)
        self.tree = LegacyTree(level)
        self._width = level.grid.shape[1]

    def look(self, agents: list[Any], places: list[Place | None]) -> None:
        """Take over where all trains are, or will depart from."""
        seen = [
            place if place is not None or agent.state == TrainState.DONE else _place(agent.initial_configuration)
            for agent, place in zip(agents, places, strict=True)
        ]
        configurations = [None if at is None else (at[0] * self._width + at[1]) * 4 + at[2] for at in seen]
        self.tree.update(configurations, [place is not None for place in places])


def _place(configuration: Any) -> Place | None:
    if configuration is None:
        return None
    (row, column), heading = configuration
    return int(row), int(column), int(heading)


class CheckpointPolicy(Policy[RailEnv, TrainView, RailEnvActions]):
    """The greedy policy of the checkpoint that RAILCTL_CHECKPOINT names; it looks at `StudyObservation`."""

    def __init__(self) -> None:
        """Read the checkpoint.

        Raises:
            click.ClickException: the variable is not set, or the file cannot be used: a line, and exit code 1.
        """
        path = os.environ.get(VARIABLE)
        if not path:
            raise click.ClickException(f"{VARIABLE} is not set: let it name a file in a run's folder checkpoints")
        try:
            self._network = load_policy(Path(path)).network
        except CheckpointError as error:
            raise click.ClickException(str(error)) from None
        self._episode = _Episode([])

    def act_many(self, handles: list[int], observations: list[TrainView], **_: Any) -> dict[int, RailEnvActions]:
        """The actions of all trains of an environment, which come in the order of their handles.

        Raises:
            click.ClickException: the observations are of another builder.
        """
        if not all(isinstance(view, TrainView) for view in observations):
            raise click.ClickException("this policy needs --obs-builder adapters.flatland_tools.StudyObservation")
        if not self._episode.goes_on(observations):
            states = self._network.zero_state(len(observations))
            self._episode = _Episode(observations, self._network.in_episode(0.0, 0, states, greedy=True))
        actions = self._episode.act(observations)
        return {handle: ACTIONS[action] for handle, action in zip(handles, actions, strict=True)}


class _Episode:
    """What trains remember from step to step."""

    def __init__(
        self,
        views: list[TrainView],
        choose: Choose = lambda *_: Decision(DO_NOTHING),
    ) -> None:
        self._drivers = [LegacyDriver() for _ in views]
        self._choose = choose
        self._step = -1

    def goes_on(self, views: list[TrainView]) -> bool:
        """Whether this is the same episode, a step or more later."""
        return len(views) == len(self._drivers) and all(view.step > self._step for view in views)

    def act(self, views: list[TrainView]) -> list[int]:
        """[N]: the actions."""
        actions = [self._act(train, view) for train, view in enumerate(views)]
        self._step = max(view.step for view in views)
        return actions

    def _act(self, train: int, view: TrainView) -> int:
        driver = self._drivers[train]
        if view.broken:
            return DO_NOTHING
        driver.look(view.place)
        decides = view.deciding and driver.committed is None
        action = self._choose(view.vector, view.step, train).action if decides else MOVE_FORWARD
        return driver.send(view.place, action, view.ways.__getitem__)
