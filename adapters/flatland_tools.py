"""Checkpoints in the console commands of flatland-rl 4.3.0: a policy, its observation and the study's rewards.

`flatland-trajectory-generate-from-policy` makes objects of these classes without arguments; the environment variable
RAILCTL_CHECKPOINT names the checkpoint. It carries its run's world: trains see and decide as they did there, behind the
same interlocking, and act greedily. The tools run the rules of 4.3.0.

A policy that has trained on levels with stock rules finds in them what it knows: an episode is the same step by step.

One that has trained under the rules of 2.2.2 alone is translated: it says its actions as 2.2.2 understood them (a
blocked train keeps to its action, see `LegacyDriver`) and sees what 2.2.2 showed. For trains of speed 1 that may depart
at once and never break down this leaves one difference:

- A train spends the first step on becoming ready to depart: all happens one step later, within the same step
  limit, and every train pays for one step more.

And where a level has more than the study:

- Timetables are not looked at: trains depart as soon as they may, and hurry.
- Slow trains decide when they enter a cell and keep to it until they leave; trees show nobody's speed.
- Broken trains do not decide; trees show them as whole.
"""

import os
from pathlib import Path
from typing import Any

import click
import numpy as np
from flatland.core.policy import Policy
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_env_action import RailEnvActions

from railctl.adapters.flatland_views import TrainView, WorldObservation
from railctl.common.checkpoint import CheckpointError
from railctl.common.config import RunConfig
from railctl.common.levels.distributions import Rules
from railctl.common.policy.checkpoints import SavedPolicy, load_policy
from railctl.common.rail.flatland_env import ACTIONS, LegacyDriver, StudyRewards
from railctl.common.rail.play import Choose, Decision
from railctl.common.rail.world import DO_NOTHING
from railctl.common.world import study_world

__all__ = ["CheckpointObservation", "CheckpointPolicy", "StudyObservation", "StudyRewards", "TrainView"]

VARIABLE = "RAILCTL_CHECKPOINT"


class CheckpointObservation(WorldObservation):
    """What trains see in the world of the checkpoint that RAILCTL_CHECKPOINT names; in the study's if it names none."""

    def __init__(self) -> None:
        """Read the checkpoint.

        Raises:
            click.ClickException: the file cannot be used: a line, and exit code 1.
        """
        if os.environ.get(VARIABLE):
            config = saved_policy().config
            super().__init__(config.world, rules_of(config))
        else:
            super().__init__(study_world(), "legacy")


StudyObservation = CheckpointObservation  # its name before checkpoints carried their world


class CheckpointPolicy(Policy[RailEnv, TrainView, RailEnvActions]):
    """The greedy policy of the checkpoint that RAILCTL_CHECKPOINT names; it looks at `CheckpointObservation`."""

    def __init__(self) -> None:
        """Read the checkpoint.

        Raises:
            click.ClickException: the variable is not set, or the file cannot be used: a line, and exit code 1.
        """
        saved = saved_policy()
        self._network, self._n_features = saved.network, saved.config.world.n_features
        self._is_legacy = rules_of(saved.config) == "legacy"
        self._episode = _Episode([], is_legacy=self._is_legacy)

    def act_many(self, handles: list[int], observations: list[TrainView], **_: Any) -> dict[int, RailEnvActions]:
        """The actions of all trains of an environment, which come in the order of their handles.

        Raises:
            click.ClickException: the observations are of another builder, or of another world.
        """
        if not all(isinstance(view, TrainView) for view in observations):
            raise click.ClickException(
                "this policy needs --obs-builder railctl.adapters.flatland_tools.CheckpointObservation"
            )
        for view in observations:
            if len(view.vector) != self._n_features:
                raise click.ClickException(
                    f"observations of {len(view.vector)} values for a network that takes {self._n_features}: "
                    f"let {VARIABLE} name the same checkpoint for both"
                )
        if not self._episode.goes_on(observations):
            states = self._network.zero_state(len(observations))
            choose = self._network.in_episode(0.0, 0, states, greedy=True)
            self._episode = _Episode(observations, choose, is_legacy=self._is_legacy)
        actions = self._episode.act(observations)
        return {handle: ACTIONS[action] for handle, action in zip(handles, actions, strict=True)}


class _Episode:
    """What trains remember from step to step."""

    def __init__(
        self,
        views: list[TrainView],
        choose: Choose = lambda *_: Decision(DO_NOTHING),
        *,
        is_legacy: bool,
    ) -> None:
        self._drivers = [LegacyDriver() for _ in views]
        self._choose = choose
        self._is_legacy = is_legacy
        self._step = -1

    def goes_on(self, views: list[TrainView]) -> bool:
        """Whether this is the same episode, a step or more later."""
        return len(views) == len(self._drivers) and all(view.step > self._step for view in views)

    def act(self, views: list[TrainView]) -> list[int]:
        """[N]: the actions. Trains are asked one after another, as the world's interlocking wants it."""
        if self._is_legacy:
            for driver, view in zip(self._drivers, views, strict=True):
                if not view.broken:
                    driver.look(view.place)
        free = [not self._is_legacy or driver.committed is None for driver in self._drivers]
        deciding = np.array([view.deciding for view in views]) & free
        signals = views[0].signals
        actions = signals.unasked()
        asking = signals.ask(deciding)
        for train, allowed in asking:
            view = views[train]
            actions[train] = self._choose(view.vector, view.step, train, allowed).action
            asking.grant(train, actions[train])
        signals.note(actions, deciding)
        self._step = max(view.step for view in views)
        return self._translated(views, actions) if self._is_legacy else actions

    def _translated(self, views: list[TrainView], actions: list[int]) -> list[int]:
        """[N]: what says to 4.3.0 what these say to 2.2.2."""
        return [
            DO_NOTHING if view.broken else driver.send(view.place, action, view.ways.__getitem__)
            for driver, view, action in zip(self._drivers, views, actions, strict=True)
        ]


def saved_policy() -> SavedPolicy:
    """The policy of the checkpoint that RAILCTL_CHECKPOINT names.

    Raises:
        click.ClickException: the variable is not set, or the file cannot be used.
    """
    path = os.environ.get(VARIABLE)
    if not path:
        raise click.ClickException(f"{VARIABLE} is not set: let it name a file in a run's folder checkpoints")
    try:
        return load_policy(Path(path))
    except CheckpointError as error:
        raise click.ClickException(str(error)) from None


def rules_of(config: RunConfig) -> Rules:
    """The rules that a run's policy knows: stock ones if any of its levels have them."""
    rules = {config.world.levels[name].rules for name in config.mix}
    return "stock" if "stock" in rules else "legacy"
