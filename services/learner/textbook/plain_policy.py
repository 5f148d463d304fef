"""Policy updates as a textbook writes them in torch: what `fused` is measured and checked against.

The losses are ours; network, gradients and optimiser are torch's own.
"""

import torch
from torch import Tensor, nn, optim

from railctl.common.policy.actor_critic import ActorCritic
from railctl.common.rules.policies import PpoConfig
from railctl.common.rules.sil import SilConfig
from railctl.services.learner.experience import Experience
from railctl.services.learner.sparse import dense_rows
from railctl.services.learner.textbook.allowing import allowed_only
from railctl.services.learner.textbook.ppo import (
    clipped_surrogate,
    clipped_value_loss,
    entropy,
    log_probability,
    standardised,
)
from railctl.services.learner.textbook.sil import imitation_policy_loss, imitation_value_loss


class PlainPolicy:
    """Trains a network in place, a batch at a time."""

    def __init__(self, network: ActorCritic, ppo: PpoConfig) -> None:
        self._network, self._ppo = network, ppo
        self._optimizer = optim.Adam(network.parameters(), lr=ppo.learning_rate)

    def update(self, batch: Experience) -> float:
        """One step of `ppo`; returns the loss."""
        logits, value = self._outputs(batch)
        return_t, before = torch.tensor(batch.return_t), torch.tensor(batch.log_probability_tm1)
        error = (return_t - value).detach()
        ratio = (log_probability(logits, torch.tensor(batch.action_tm1)) - before).exp()
        advantage = standardised(error) if self._ppo.advantages == "standardised" else error
        surrogate = clipped_surrogate(ratio, advantage, self._ppo.clip).mean()
        value_loss = clipped_value_loss(value, torch.tensor(batch.value_tm1), return_t, self._ppo.clip).mean()
        bonus = entropy(logits).mean()
        return self._descend(-surrogate + self._ppo.value_weight * value_loss - self._ppo.entropy_weight * bonus)

    def imitate(self, batch: Experience, sil: SilConfig) -> float:
        """One step of `sil`; returns the loss."""
        logits, value = self._outputs(batch)
        return_t = torch.tensor(batch.least_return_t)
        gain = (return_t - value).detach().clamp(min=0)
        policy_loss = imitation_policy_loss(log_probability(logits, torch.tensor(batch.action_tm1)), gain).mean()
        return self._descend(policy_loss + sil.value_weight * imitation_value_loss(value, return_t).mean())

    def _outputs(self, batch: Experience) -> tuple[Tensor, Tensor]:
        logits, value = self._network(torch.from_numpy(dense_rows(batch.observation_tm1)))
        return allowed_only(logits, torch.tensor(batch.allowed_tm1)), value

    def _descend(self, loss: Tensor) -> float:
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for half in ("actor", "critic"):
            parameters = [weight for name, weight in self._network.named_parameters() if name.startswith(half)]
            nn.utils.clip_grad_norm_(parameters, self._ppo.max_gradient_norm)
        self._optimizer.step()
        return loss.item()
