"""The network of a policy for training: what `common.policy.actor_critic` defines, with gradients and steps of Adam.

Only a loss on top of the outputs goes through autograd; any other module goes the plain path, see `modules`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from common.policy.actor_critic import ActorCritic
from common.policy.networks import export_tensors, import_tensors
from services.learner.network.adam import Adam
from services.learner.network.layers import TANH, Linear, Perceptron
from services.learner.network.modules import ModulePolicy
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


class PolicyBody(Protocol):
    """A copy of an actor-critic to train: outputs and gradients.

    Attributes:
        parts: of the flat gradient, each of which is clipped on its own.
    """

    parameters: Parameters
    parts: Sequence[Tensor]

    def forward(self, x: SparseRows) -> tuple[Tensor, Tensor]:
        """[B, F] to logits [B, A] and values [B], valid until the next call."""

    def values(self, x: SparseRows) -> Tensor:
        """[B, F] to values [B], valid until the next call."""

    def backward(self, by_logits: Tensor, by_value: Tensor) -> None:
        """From the gradients of the last outputs, [B, A] and [B], to those of the parameters."""


class Halves:
    """Actor and critic of an `ActorCritic`, on the fast path."""

    def __init__(self, network: ActorCritic) -> None:
        self.parameters = Parameters(network)
        depth = len(network.actor_hidden)
        self._actor, self._critic = (Half(self.parameters, name, depth) for name in ("actor", "critic"))
        n_actor = int(self.parameters.gradient("critic_hidden.0.weight").storage_offset())  # the actor's lie first
        gradient = self.parameters.flat_gradient
        self.parts: Sequence[Tensor] = (gradient[:n_actor], gradient[n_actor:])

    def forward(self, x: SparseRows) -> tuple[Tensor, Tensor]:
        return self._actor.forward(x), self._critic.forward(x).squeeze(-1)

    def values(self, x: SparseRows) -> Tensor:
        return self._critic.forward(x).squeeze(-1)

    def backward(self, by_logits: Tensor, by_value: Tensor) -> None:
        self._actor.backward(by_logits)
        self._critic.backward(by_value.unsqueeze(-1))


def policy_body(network: nn.Module, n_features: int) -> PolicyBody:
    """A copy of a network to train: on the fast path if there is one for its class."""
    return Halves(network) if isinstance(network, ActorCritic) else ModulePolicy(network, n_features)


class PolicyNetwork:
    """Trains an actor-critic: `outputs` of a batch, then `descend` on a loss made of them."""

    def __init__(
        self, network: nn.Module, learning_rate: float, max_gradient_norm: float, n_features: int | None = None
    ) -> None:
        """The parameters start as a copy of those of `network`: an `ActorCritic`, or any module with outputs like its.

        Args:
            network: on the fast path if it is an `ActorCritic`.
            learning_rate: of Adam.
            max_gradient_norm: of actor and critic each, or of all if they share parameters.
            n_features: F; None: as the network says of itself.
        """
        self.n_features = int(network.n_features if n_features is None else n_features)  # type: ignore[arg-type]
        self._body: PolicyBody = policy_body(network, self.n_features)
        self._parameters = self._body.parameters
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
    def values(self, x: SparseRows) -> Tensor:
        """A copy of the values [B] of observations [B, F]."""
        return self._body.values(x).clone()

    def descend(self, loss: Tensor) -> float:
        """A step of Adam on a loss of the last `outputs`, the gradients of actor and critic clipped each.

        Returns:
            The L2 norm of all gradients, before they are clipped.
        """
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
