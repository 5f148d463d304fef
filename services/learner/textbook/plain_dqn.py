"""Deep Q-learning as a textbook writes it in torch: what `fused` is measured and checked against."""

import copy

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from railctl.common.policy.networks import export_parameters
from railctl.common.policy.recurrent import RecurrentQNetwork
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.sparse import Observations, dense_rows
from railctl.services.learner.textbook.allowing import allowed_only
from railctl.services.learner.textbook.dqn import TensorBatch
from railctl.services.learner.training import Batch


class PlainDqn:
    """Trains a network in place, a batch at a time, as `Dqn` does, the double rule left out."""

    def __init__(self, config: DqnConfig, network: nn.Module) -> None:
        self._tau = config.target_tau
        self._network = network
        self._target = network if self._tau is None else copy.deepcopy(network)
        self._optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)

    def update(self, batch: Batch) -> float:
        """One step of Adam, and one of the target network; returns the loss."""
        own = TensorBatch.of(batch)
        with torch.no_grad():
            q_t = allowed_only(action_values(self._target, batch.observation_t), own.allowed_t)
            target = own.reward_t + own.discount_t * q_t.max(dim=1).values
        q_tm1 = action_values(self._network, batch.observation_tm1)
        taken = q_tm1.gather(1, own.action_tm1.unsqueeze(1)).squeeze(1)
        loss = (own.weights * (taken - target) ** 2).mean()
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._optimizer.step()
        if self._tau is not None:
            with torch.no_grad():
                for slow, fast in zip(self._target.parameters(), self._network.parameters(), strict=True):
                    slow.mul_(1 - self._tau).add_(self._tau * fast)
        return loss.item()

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """A copy of the parameters."""
        return export_parameters(self._network)


def action_values(network: nn.Module, observations: Observations) -> Tensor:
    """[B, A], of observations [B, F], or of the last of sequences [L, B, F]."""
    observation = torch.from_numpy(dense_rows(observations))
    if isinstance(network, RecurrentQNetwork):
        q: Tensor = network(observation)[0][-1]
        return q
    values: Tensor = network(observation)
    return values
