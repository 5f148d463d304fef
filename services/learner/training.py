"""Training on one episode after another: replay, algorithm and counters, with neither bus nor disk.

The walk restores the text's interleaving: an episode comes whole, but its transitions enter the replay in the
order in which they were completed, and updates fall between them, one every `learn_every_steps` environment
steps, as if the learner had stepped the world itself.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config import DqnConfig, NetworkConfig, ReplayConfig
from common.policy.networks import QNetwork, build_network, export_parameters
from common.records import Episode
from common.seeding import stream_key
from services.learner.algorithms.dqn import Batch, Dqn
from services.learner.replay.replay import Replay
from services.learner.replay.transitions import Transitions, transitions

COUNTERS = ("episodes", "steps", "updates")
COLUMNS = {"action_tm1": np.int8, "reward_t": np.float32, "discount_t": np.float32}
ROWS = ("observation_tm1", "observation_t")


class Trainer:
    """Everything that learning changes: a function of the settings and of the episodes, in order."""

    def __init__(  # noqa: PLR0913  (sections, not the whole config)
        self,
        *,
        seed: int,
        discount: float,
        network: NetworkConfig,
        dqn: DqnConfig,
        replay: ReplayConfig,
        n_features: int,
        n_actions: int,
    ) -> None:
        self._seed = seed
        self._discount = discount
        self._config = dqn
        self.network: QNetwork = build_network(network, n_features, n_actions, seed)
        self._algorithm = Dqn(dqn, self.network)
        self._replay = Replay(replay, COLUMNS, ROWS, n_features)
        self._counters = dict.fromkeys(COUNTERS, 0)

    @property
    def episodes(self) -> int:
        """Episodes trained on so far: the version of `weights`."""
        return self._counters["episodes"]

    def train(self, episode: Episode) -> dict[str, float]:
        """Add an episode's transitions, and make the updates that fall due on its steps.

        An update falls due every `learn_every_steps` environment steps, counted across episodes, and is left
        out as long as the replay holds less than a batch.

        Returns:
            `updates` and `transitions`, how many there were; and, if there were any updates, the means of
            their metrics: `loss`, `mean_q`, `gradient_norm`.

        Raises:
            ValueError: the episode does not fit the network, or its decisions are out of order.
        """
        n_features = episode.observations.shape[1]
        if n_features != self.network.n_features:
            raise ValueError(
                f"episode {episode.episode} has {n_features} features, the network {self.network.n_features}"
            )
        new = transitions(episode, self._discount)
        metrics: list[dict[str, float]] = []
        added = 0
        for step in self._learning_steps(episode.rewards.shape[0]):
            known = int(np.searchsorted(new.completed_at, step, side="right"))
            self._add(new[added:known])
            added = known
            if len(self._replay) >= self._config.batch_size:
                metrics.append(self._update())
        self._add(new[added:])
        self._counters["steps"] += episode.rewards.shape[0]
        self._counters["episodes"] += 1
        means = {name: float(np.mean([row[name] for row in metrics])) for name in metrics[0]} if metrics else {}
        return {"updates": float(len(metrics)), "transitions": float(len(new)), **means}

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """A copy of the network's parameters."""
        return export_parameters(self.network)

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of everything: `algorithm/*`, `replay/*`, and the counters, int64."""
        return {
            **{f"algorithm/{name}": array for name, array in self._algorithm.state().items()},
            **{f"replay/{name}": array for name, array in self._replay.state().items()},
            **{f"trainer/{name}": np.array(count, np.int64) for name, count in self._counters.items()},
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take on a `state` of a trainer with the same settings: all that follows is the same to the bit.

        Raises:
            ValueError: naming the tensor that is missing, unknown or does not fit.
        """
        parts: dict[str, dict[str, NDArray[Any]]] = {"algorithm": {}, "replay": {}, "trainer": {}}
        for name, array in state.items():
            part, _, rest = name.partition("/")
            if part not in parts:
                raise ValueError(f"tensor {name} is unknown here: this is not the state of a trainer")
            parts[part][rest] = array
        if different := sorted(set(parts["trainer"]) ^ set(COUNTERS)):
            raise ValueError(f"tensor trainer/{different[0]} is missing or unknown: wants {', '.join(COUNTERS)}")
        self._algorithm.restore(parts["algorithm"])
        self._replay.restore(parts["replay"])
        self._counters = {name: int(parts["trainer"][name]) for name in COUNTERS}

    def _learning_steps(self, steps: int) -> Iterator[int]:
        """The steps 1..`steps` of this episode after which an update falls due."""
        every = self._config.learn_every_steps
        return iter(range(every - self._counters["steps"] % every, steps + 1, every))

    def _add(self, new: Transitions) -> None:
        self._replay.add({name: getattr(new, name) for name in (*COLUMNS, *ROWS)})

    def _update(self) -> dict[str, float]:
        number = self._counters["updates"]
        rng = np.random.Generator(np.random.Philox(key=stream_key(self._seed, number, "replay")))
        sample = self._replay.sample(self._config.batch_size, rng)
        metrics = self._algorithm.update(Batch(**sample.columns))
        self._counters["updates"] += 1
        return metrics
