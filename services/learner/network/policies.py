"""The network of a policy for training: what `common.policy.actor_critic` defines, with gradients and steps of Adam.

Only a loss on top of the outputs goes through autograd.
"""

import math
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.policy.actor_critic import ActorCritic
from common.policy.networks import export_tensors, import_tensors
from services.learner.network.adam import Adam
from services.learner.network.layers import TANH, Linear, Perceptron
from services.learner.network.parameters import Parameters
from services.learner.network.sparse import SparseRows


class Half:
    """The actor or the critic: hidden layers with Tanh, and a head."""

    def __init__(self, parameters: Parameters, name: str, depth: int) -> None:
        self._hidden = Perceptron(parameters, f"{name}_hidden", depth, TANH)
        self._head = Linear(parameters, name)

    def forward(self, x: SparseRows) -> Tensor:
        """[B, F] to [B, O]."""
        return self._head.forward(self._hidden.forward(x))

    def backward(self, gradient: Tensor) -> None:
        """From the gradient of the last outputs [B, O] to those of the parameters."""
        self._hidden.backward(self._head.backward(gradient))


class PolicyNetwork:
    """Trains an actor-critic: `outputs` of a batch, then `descend` on a loss made of them."""

    def __init__(self, network: ActorCritic, learning_rate: float, max_gradient_norm: float) -> None:
        """The parameters start as a copy of those of `network`."""
        self.n_features = network.n_features
        self._parameters = Parameters(network)
        depth = len(network.actor_hidden)
        self._actor, self._critic = (Half(self._parameters, name, depth) for name in ("actor", "critic"))
        n_actor = int(self._parameters.gradient("critic_hidden.0.weight").storage_offset())  # the actor's lie first
        gradient = self._parameters.flat_gradient
        self._gradients = (gradient[:n_actor], gradient[n_actor:])
        self._limit = max_gradient_norm
        self._adam = Adam(self._parameters, learning_rate)
        self._outputs: tuple[Tensor, Tensor]

    @torch.no_grad()
    def outputs(self, x: SparseRows) -> tuple[Tensor, Tensor]:
        """Logits [B, A] and values [B] of observations [B, F], as leaves of autograd; valid until the next call."""
        logits, value = self._actor.forward(x), self._critic.forward(x).squeeze(-1)
        self._outputs = logits.detach().requires_grad_(), value.detach().requires_grad_()
        return self._outputs

    @torch.no_grad()
    def values(self, x: SparseRows) -> Tensor:
        """A copy of the values [B] of observations [B, F]."""
        return self._critic.forward(x).squeeze(-1).clone()

    def descend(self, loss: Tensor) -> float:
        """A step of Adam on a loss of the last `outputs`, the gradients of actor and critic clipped each.

        Returns:
            The L2 norm of all gradients, before they are clipped.
        """
        by_logits, by_value = torch.autograd.grad(loss, self._outputs)
        with torch.no_grad():
            self._actor.backward(by_logits)
            self._critic.backward(by_value.unsqueeze(-1))
            norms = [torch.linalg.vector_norm(gradient).item() for gradient in self._gradients]
            for gradient, norm in zip(self._gradients, norms, strict=True):
                if norm > self._limit:
                    gradient.mul_(self._limit / norm)
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
