"""A module of a policy that learns as `algorithms.ppo` and `sil` say: gradients by autograd, steps of Adam.

`fused.policy` does the same for the networks of `common.policy.actor_critic`, several times as fast.
"""

import math
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from railctl.common.policy.networks import export_tensors, import_tensors
from railctl.common.rules.policies import PpoConfig
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused.policy import PPO_NUMBERS, Imitation
from railctl.services.learner.sparse import SparseRows
from railctl.services.learner.textbook.adam import Adam
from railctl.services.learner.textbook.allowing import allowed_only
from railctl.services.learner.textbook.modules import ModulePolicy
from railctl.services.learner.textbook.ppo import (
    clipped_surrogate,
    clipped_value_loss,
    divergence,
    entropy,
    log_probability,
    standardised,
)
from railctl.services.learner.textbook.sil import imitation_policy_loss, imitation_value_loss


class PolicyNetwork:
    """Trains an actor-critic: `outputs` of a batch, then `descend` on a loss made of them."""

    def __init__(
        self, network: nn.Module, learning_rate: float, max_gradient_norm: float, n_features: int | None = None
    ) -> None:
        """The parameters start as a copy of those of `network`, any module with outputs like those of an `ActorCritic`.

        Args:
            network: what to train.
            learning_rate: of Adam.
            max_gradient_norm: of actor and critic each, or of all if they share parameters.
            n_features: F; None: as the network says of itself.
        """
        self.n_features = int(network.n_features if n_features is None else n_features)  # type: ignore[arg-type]
        self._body = ModulePolicy(network, self.n_features)
        self._parameters = self._body.parameters
        self._start = ModulePolicy(network, self.n_features)
        self._limit = max_gradient_norm
        self._adam = Adam(self._parameters, learning_rate)
        self._outputs: tuple[Tensor, Tensor]

    @torch.no_grad()
    def outputs(self, x: SparseRows) -> tuple[Tensor, Tensor]:
        """Logits [B, A] and values [B] of observations [B, F], as leaves of autograd; valid until the next call."""
        logits, value = self._body.forward(x)
        self._outputs = logits.detach().requires_grad_(), value.detach().requires_grad_()
        return self._outputs

    @torch.no_grad()
    def values(self, x: SparseRows) -> NDArray[np.float32]:
        """The values [B] of observations [B, F]."""
        return self._body.values(x).numpy().copy()

    @torch.no_grad()
    def reconsider(self, x: SparseRows, batch: Experience) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """See `services.learner.policy_training.Policy`."""
        logits, value = self._outputs_of(x, batch)
        return log_probability(logits, torch.tensor(batch.action_tm1)).numpy(), value.numpy().copy()

    def ppo(self, config: PpoConfig, x: SparseRows, batch: Experience, count: int) -> NDArray[np.float64]:
        """See `services.learner.policy_training.Policy`."""
        numbers = np.zeros((count, PPO_NUMBERS))
        anchor = None
        if config.anchor_weight:
            anchor = allowed_only(self._start.forward(x)[0], torch.tensor(batch.allowed_tm1))
        for row in numbers:
            row[:] = self._ppo(config, x, batch, anchor)
            if not math.isfinite(row[-1]):
                break
        return numbers

    def _ppo(self, config: PpoConfig, x: SparseRows, batch: Experience, anchor: Tensor | None) -> tuple[float, ...]:
        action, return_t = torch.tensor(batch.action_tm1), torch.tensor(batch.return_t)
        logits, value = self._outputs_of(x, batch)
        error = (return_t - value).detach()
        log_ratio = log_probability(logits, action) - torch.tensor(batch.log_probability_tm1)
        ratio = log_ratio.exp()
        advantage = standardised(error) if config.advantages == "standardised" else error
        policy_loss = -clipped_surrogate(ratio, advantage, config.clip).mean()
        value_loss = clipped_value_loss(value, torch.tensor(batch.value_tm1), return_t, config.clip).mean()
        bonus = entropy(logits).mean()
        loss = policy_loss + config.value_weight * value_loss - config.entropy_weight * bonus
        if anchor is not None:
            loss = loss + config.anchor_weight * divergence(logits, anchor).mean()
        return (
            policy_loss.item(),
            value_loss.item(),
            bonus.item(),
            error.abs().mean().item(),
            ((ratio - 1).abs() > config.clip).float().mean().item(),
            (ratio - 1 - log_ratio).mean().item(),
            self.descend(loss),
            loss.item(),
        )

    def imitate(self, value_weight: float, x: SparseRows, batch: Experience) -> Imitation:
        """See `services.learner.policy_training.Policy`."""
        return_t = torch.tensor(batch.least_return_t)
        logits, value = self._outputs_of(x, batch)
        gain = (return_t - value).detach().clamp(min=0)
        policy_loss = imitation_policy_loss(log_probability(logits, torch.tensor(batch.action_tm1)), gain).mean()
        value_loss = imitation_value_loss(value, return_t).mean()
        loss = policy_loss + value_weight * value_loss
        numbers = (
            policy_loss.item(),
            value_loss.item(),
            gain.mean().item(),
            (gain > 0).float().mean().item(),
            self.descend(loss),
            loss.item(),
        )
        return np.array(numbers), gain.numpy()

    def clone(self, value_weight: float, learning_rate: float, x: SparseRows, batch: Experience) -> NDArray[np.float64]:
        """See `services.learner.policy_training.Policy`."""
        action, return_t = torch.tensor(batch.action_tm1), torch.tensor(batch.return_t)
        logits, value = self._outputs_of(x, batch)
        cross_entropy, value_loss = -log_probability(logits, action).mean(), (value - return_t).square().mean()
        agreement = (logits.argmax(-1) == action).float().mean()
        loss = cross_entropy + value_weight * value_loss
        self._adam.learning_rate = learning_rate
        told = (cross_entropy.item(), value_loss.item(), agreement.item(), self.descend(loss), loss.item())
        return np.array(told)

    def _outputs_of(self, x: SparseRows, batch: Experience) -> tuple[Tensor, Tensor]:
        """As `outputs`, the logits of the actions that were allowed."""
        logits, value = self.outputs(x)
        return allowed_only(logits, torch.tensor(batch.allowed_tm1)), value

    def descend(self, loss: Tensor) -> float:
        """A step of Adam on a loss of the last `outputs`, unless it is not finite; actor and critic are clipped each.

        Returns:
            The L2 norm of all gradients, before they are clipped; zero if there was no step.
        """
        if not math.isfinite(loss.item()):
            return 0.0
        by_logits, by_value = torch.autograd.grad(loss, self._outputs)
        with torch.no_grad():
            self._body.backward(by_logits, by_value)
            norms = [torch.linalg.vector_norm(part).item() for part in self._body.parts]
            for part, norm in zip(self._body.parts, norms, strict=True):
                if norm > self._limit:
                    part.mul_(self._limit / norm)
            self._adam.step()
        return math.hypot(*norms)

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """A copy of the parameters, by the names of `ActorCritic`."""
        return export_tensors(self._parameters.named(self._parameters.flat))

    def state(self) -> dict[str, NDArray[np.float32]]:
        """A copy of all that `descend` changes: `network/*` and what Adam keeps."""
        return export_tensors(self._tensors())

    def restore(self, state: Mapping[str, NDArray[np.float32]]) -> None:
        """Take on a `state`: all that follows is the same to the bit.

        Raises:
            ValueError: naming the tensor that does not fit; then nothing has changed.
        """
        import_tensors(self._tensors(), state)

    def _tensors(self) -> dict[str, Tensor]:
        named = self._parameters.named(self._parameters.flat)
        return {f"network/{name}": view for name, view in named.items()} | self._adam.tensors()
