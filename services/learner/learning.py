"""What learning is to the service: a trainer that takes episodes in order, built by the update rule of the run.

An update rule is a module of `services.learner.algorithms` with a function `build(learning) -> Trainer`.
"""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from common.config import DqnConfig, NetworkConfig, PpoConfig, ReplayConfig, RunConfig, SilConfig
from common.rail.normalise import N_FEATURES
from common.rail.world import N_ACTIONS
from common.records.acting import Fragment


@dataclass(frozen=True)
class Learning:
    """What a learning curve depends on besides the episodes; sections as in `RunConfig`."""

    seed: int
    episodes: int
    discount: float
    network: NetworkConfig
    dqn: DqnConfig | None = None
    ppo: PpoConfig | None = None
    sil: SilConfig | None = None
    replay: ReplayConfig | None = None
    n_features: int = N_FEATURES
    n_actions: int = N_ACTIONS

    @classmethod
    def of(cls, config: RunConfig) -> "Learning":
        """The part of a run's configuration that learning sees."""
        return cls(
            seed=config.seed,
            episodes=config.episodes,
            discount=config.discount,
            network=config.network,
            dqn=config.dqn,
            ppo=config.ppo,
            sil=config.sil,
            replay=config.replay,
        )


class Trainer(Protocol):
    """Everything that learning changes: a function of `Learning` and of the episodes, in order."""

    def train(self, fragment: Fragment) -> dict[str, float]:
        """Learn from an episode or its next fragment; returns its metrics, by name."""

    def weights(self) -> dict[str, NDArray[np.float32]]:
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
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: float(np.mean([row[name] for row in rows if name in row])) for name in names}


def build_trainer(rule: str, learning: Learning) -> Trainer:
    """The trainer of an update rule.

    Raises:
        ValueError: the rule lacks a section of the configuration that it needs.
    """
    return cast("Trainer", importlib.import_module(f"services.learner.algorithms.{rule}").build(learning))
