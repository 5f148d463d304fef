"""Choosing an action, one observation at a time.

A matrix product may round a row differently with the number of rows beside it. What a train does must not
depend on what else is in a batch, so each observation goes through the network alone, in a row of torch's own
memory.
"""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from railctl.common.policy.choosing import draw_counter
from railctl.common.policy.networks import QNetwork
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.seeding import uniform


class EpsilonGreedy:
    """Epsilon-greedy choice over the action values of a network; epsilon 0 is the greedy policy."""

    def __init__(self, n_features: int, n_actions: int) -> None:
        self._n_actions = n_actions
        self._row = torch.zeros(1, n_features)
        self._row_array = self._row[0].numpy()  # the same memory

    def in_episode(self, network: QNetwork, epsilon: float, key: int, n_trains: int) -> Callable[..., int]:
        """The choice of an action by (observation [F], step, train) and what is allowed; as `act`.

        For one episode of `n_trains`.
        """

        def choose(observation: NDArray[np.float32], step: int, train: int, allowed: int = ALL_ACTIONS) -> int:
            return self.act(network, observation, epsilon, key, draw_counter(step, n_trains, train), allowed)

        return choose

    def act(  # noqa: PLR0913  (a network, and all that a choice depends on)
        self,
        network: QNetwork,
        observation: NDArray[np.float32],
        epsilon: float,
        key: int,
        counter: int,
        allowed: int = ALL_ACTIONS,
    ) -> int:
        """The action for one observation.

        Args:
            network: scores the actions.
            observation: [F].
            epsilon: the probability of an action drawn uniformly from those allowed.
            key: of the episode's stream of exploration.
            counter: of this decision, see `draw_counter`.
            allowed: actions, a bit each.

        Returns:
            0..A-1; of equally good actions the lowest.
        """
        actions = [action for action in range(self._n_actions) if allowed >> action & 1]
        if uniform(key, counter) < epsilon:
            return actions[int(uniform(key, counter + 1) * len(actions))]
        best = self.values(network, observation)[actions].argmax()  # numpy's takes the first maximum, torch's any
        return actions[int(best)]

    def values(self, network: QNetwork, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The action values [A] of one observation [F]."""
        self._row_array[:] = observation
        with torch.inference_mode():
            values: NDArray[np.float32] = network(self._row)[0].numpy()
        return values
