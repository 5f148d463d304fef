"""Training on one episode after another: replay, value method and counters, with neither bus nor disk.

The walk restores the text's interleaving: an episode comes whole or in fragments, but its transitions enter the replay
in the order in which they were completed, and updates fall between them, one every `learn_every_steps` environment
steps, as if the learner had stepped the world itself.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from railctl.common.policy.flat import Arrays
from railctl.common.records.acting import Fragment
from railctl.common.rules.replay import UniformReplay
from railctl.common.rules.values import ValueSettings
from railctl.common.seeding import stream_key
from railctl.services.learner.former import with_all_allowed
from railctl.services.learner.learning import Learning, by_part, means
from railctl.services.learner.replay.replay import Replay, Sample
from railctl.services.learner.replay.transitions import COLUMNS, ROWS, TransitionMaker
from railctl.services.learner.sparse import Observations

COUNTERS = ("episodes", "steps", "updates")

# What the network sees before and after each transition:
Look = Callable[[Replay, Sample], tuple[Observations, Observations]]


class Batch(NamedTuple):
    """B transitions; observations are [B, F], or sequences [L, B, F] that end there."""

    observation_tm1: Observations
    action_tm1: NDArray[np.int64]  # [B]
    reward_t: NDArray[np.float32]  # [B]
    discount_t: NDArray[np.float32]  # [B]
    allowed_t: NDArray[np.int64]  # [B], actions that may follow, a bit each
    observation_t: Observations
    weights: NDArray[np.float32]  # [B], of each transition's squared error


class Update(NamedTuple):
    """What came of a batch."""

    error_sizes: NDArray[np.float32]  # [B]
    metrics: dict[str, float]


class ValueMethod(Protocol):
    """Learns action values from batches."""

    def update(self, batch: Batch) -> Update:
        """Learn from a batch."""

    def follow(self, share: float) -> None:
        """Move the target network a share towards the online one."""

    def weights(self) -> Arrays:
        """A copy of the parameters to act with."""

    def state(self) -> dict[str, NDArray[np.float32]]:
        """A copy of all that updates change."""

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take on a `state`; raises ValueError, naming the tensor that does not fit."""


class ValueTrainer:
    """The trainer of value methods; see `learning.Trainer`."""

    def __init__(self, learning: Learning[ValueSettings], method: ValueMethod, look: Look) -> None:
        """`look` gives the observations of a batch."""
        self._config, self._replay_config = learning.settings.dqn, learning.settings.replay
        self._learning = learning
        self._method = method
        self._look = look
        self._maker = TransitionMaker(learning.settings.discount)
        self._replay = Replay(self._replay_config, COLUMNS, ROWS, learning.n_features)
        self._counters = dict.fromkeys(COUNTERS, 0)

    def train(self, fragment: Fragment) -> dict[str, float]:
        """Add the transitions that an episode, or its next fragment, completes; make the updates that fall due.

        An update falls due every `learn_every_steps` environment steps, counted across episodes, and is left out as
        long as the replay holds less than a batch. With `target_every: episode` the target network follows when all
        updates of an episode are made.

        Returns:
            `updates` and `transitions`, how many there were; the metrics of the replay; and, if there were updates, the
            means of their metrics.

        Raises:
            ValueError: the episode does not fit the network, is not the next fragment, or its decisions are out of
                order.
        """
        course = fragment.course
        n_features, n_following = course.decisions.observations.shape[1], course.decisions.following.shape[1]
        if n_features != self._learning.n_features:
            raise ValueError(
                f"episode {fragment.lease.episode} has {n_features} features, the network {self._learning.n_features}"
            )
        if n_following != (wanted := n_features if self._learning.settings.learns_from_following else 0):
            raise ValueError(
                f"episode {fragment.lease.episode} has {n_following} features a step later, the rule wants {wanted}"
            )
        new = self._maker.take(fragment)
        completed_at: list[int] = new.completed_at.tolist()
        metrics: list[dict[str, float]] = []
        added, steps = 0, len(course.rewards)
        for step in self._learning_steps(steps):
            known = bisect_right(completed_at, course.first_step + step)
            self._replay.append(new.items.part(added, known))
            added = known
            if len(self._replay) >= self._config.batch_size:
                metrics.append(self._update())
        self._replay.append(new.items.part(added, len(new)))
        self._counters["steps"] += steps
        if course.over:
            self._counters["episodes"] += 1
            self._replay.temper(self._progress)
            if self._config.share_an_episode:
                self._method.follow(self._config.share_an_episode)
        return {
            "updates": float(len(metrics)),
            "transitions": float(len(new)),
            **self._replay.metrics(),
            **means(metrics),
        }

    def weights(self) -> Arrays:
        """A copy of the network's parameters."""
        return self._method.weights()

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of everything but the open episode: `algorithm/*`, `replay/*`, and the counters, int64."""
        return {
            **{f"algorithm/{name}": array for name, array in self._method.state().items()},
            **{f"replay/{name}": array for name, array in self._replay.state().items()},
            **{f"trainer/{name}": np.array(count, np.int64) for name, count in self._counters.items()},
        }

    def restore(self, state: Mapping[str, NDArray[Any]], opened: Sequence[Fragment] = ()) -> None:
        """Take on a `state` of a trainer with the same settings: all that follows is the same to the bit.

        Args:
            state: as `state` gave it.
            opened: the fragments, trained on already, of the episode that was open then.

        Raises:
            ValueError: naming the tensor that is missing, unknown or does not fit.
        """
        parts = by_part(state, "algorithm", "replay", "trainer")
        if different := sorted(set(parts["trainer"]) ^ set(COUNTERS)):
            raise ValueError(f"tensor trainer/{different[0]} is missing or unknown: wants {', '.join(COUNTERS)}")
        self._method.restore(parts["algorithm"])
        self._counters = {name: int(parts["trainer"][name]) for name in COUNTERS}
        self._replay.restore(with_all_allowed(parts["replay"], "allowed_t"), self._progress)
        self._maker.forget()
        for fragment in opened:
            self._maker.take(fragment)  # its transitions are in the replay

    def _learning_steps(self, steps: int) -> Iterator[int]:
        """The steps 1..`steps` from here after which an update falls due."""
        every = self._config.learn_every_steps
        return iter(range(every - self._counters["steps"] % every, steps + 1, every))

    def _update(self) -> dict[str, float]:
        key = stream_key(self._learning.seed, self._counters["updates"], "replay")
        sample = self._replay.sample(self._config.batch_size, key, self._beta)
        columns = sample.columns
        before, after = self._look(self._replay, sample)
        batch = Batch(
            observation_tm1=before,
            action_tm1=columns["action_tm1"],
            reward_t=columns["reward_t"],
            discount_t=columns["discount_t"],
            allowed_t=columns["allowed_t"],
            observation_t=after,
            weights=sample.weights,
        )
        update = self._method.update(batch)
        self._replay.reprioritise(sample.places, update.error_sizes)
        self._counters["updates"] += 1
        return update.metrics

    @property
    def _beta(self) -> float:
        """The exponent of the importance weights: from `replay.beta` in a run's first episode to 1 after its last."""
        if isinstance(self._replay_config, UniformReplay):
            return 0.0  # there are none
        first = self._replay_config.beta
        return first + (1 - first) * min(1.0, self._progress)

    @property
    def _progress(self) -> float:
        """Episodes so far, as a share of the run's."""
        return self._counters["episodes"] / self._learning.episodes
