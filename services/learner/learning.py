"""What learning is to the service: a trainer that takes episodes in order, built by the update rule of the run.

An update rule is a module of `services.learner.algorithms` with a function `build(learning) -> Trainer`.
"""

import importlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from railctl.common.policy.flat import Arrays
from railctl.common.rail.world import N_ACTIONS
from railctl.common.records.acting import Fragment
from railctl.common.records.course import Course
from railctl.common.rules.settings import RuleSettings

if TYPE_CHECKING:  # algorithms, which come here, are not to see it
    from railctl.common.config import RunConfig

S_co = TypeVar("S_co", bound=RuleSettings, covariant=True)


@dataclass(frozen=True)
class Learning(Generic[S_co]):
    """What a learning curve depends on besides the episodes.

    Attributes:
        seed: of the run.
        episodes: of the run.
        settings: of its rule.
        n_features: F, what trains see.
        n_actions: A.
        least_reward: what a train gets in a step that gets the least for ever.
        off_policy: whether episodes may have been acted with any older weights; rules that it would mislead correct it.
        start: the parameters of the network that the run begins with, by name; None: the seed makes them.
        demonstrations: that a replay begins with.
    """

    seed: int
    episodes: int
    settings: S_co
    n_features: int
    n_actions: int = N_ACTIONS
    least_reward: float = -1.0
    off_policy: bool = False
    start: Mapping[str, NDArray[np.float32]] | None = None
    demonstrations: Iterable[Course] = ()


def learning_of(
    config: "RunConfig",
    start: Mapping[str, NDArray[np.float32]] | None = None,
    demonstrations: Iterable[Course] = (),
) -> Learning[RuleSettings]:
    """The part of a run's configuration that learning sees, and what it begins with, if that is given."""
    world = config.world
    return Learning(
        config.seed,
        config.episodes,
        config.learning,
        world.n_features,
        least_reward=world.reward.floor,
        off_policy=config.is_free,
        start=start,
        demonstrations=demonstrations,
    )


class Trainer(Protocol):
    """Everything that learning changes: a function of `Learning` and of the episodes, in order."""

    def train(self, fragment: Fragment) -> dict[str, float]:
        """Learn from an episode or its next fragment; returns its metrics, by name."""

    def weights(self) -> Arrays:
        """A copy of the parameters that actors act with."""

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of everything but the open episode."""

    def restore(self, state: Mapping[str, NDArray[Any]], opened: Sequence[Fragment] = ()) -> None:
        """Take on the `state` of a trainer with the same settings: all that follows is the same to the bit.

        Args:
            state: as `state` gave it.
            opened: the fragments, trained on already, of the episode that was open then.

        Raises:
            ValueError: naming the tensor that is missing, unknown or does not fit.
        """


def by_part(state: Mapping[str, NDArray[Any]], *parts: str) -> dict[str, dict[str, NDArray[Any]]]:
    """A state whose names are `part/rest`, taken apart.

    Raises:
        ValueError: naming a tensor that belongs to no part.
    """
    found: dict[str, dict[str, NDArray[Any]]] = {part: {} for part in parts}
    for name, array in state.items():
        part, _, rest = name.partition("/")
        if part not in found:
            raise ValueError(f"tensor {name} is unknown here: this is the state of another kind of trainer")
        found[part][rest] = array
    return found


def means(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The mean of each metric over the updates that have it."""
    if len(rows) == 1:  # as a fragment's updates mostly are
        return dict(rows[0])
    names = dict.fromkeys(name for row in rows for name in row)
    told = {name: [row[name] for row in rows if name in row] for name in names}
    return {name: sum(values) / len(values) for name, values in told.items()}


def check_metrics(metrics: Mapping[str, float]) -> None:
    """Raises FloatingPointError for what is not a number or infinite, which no loss may have shown."""
    for name, value in metrics.items():
        if not math.isfinite(value):
            raise FloatingPointError(f"{name} is {value}: training has diverged, lower the learning rate")


def build_trainer(rule: str, learning: Learning[RuleSettings]) -> Trainer:
    """The trainer of an update rule, for settings of this rule."""
    if learning.settings.learns_with_torch:
        from railctl.common.policy.determinism import deterministic_torch  # noqa: PLC0415  (torch takes seconds)

        deterministic_torch()
    return cast("Trainer", importlib.import_module(f"railctl.services.learner.algorithms.{rule}").build(learning))
