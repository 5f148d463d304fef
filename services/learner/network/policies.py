"""A module of a policy for training: gradients by autograd (see `modules`), clipped, and steps of Adam.

`fused.policy` does the same for the networks of `common.policy.actor_critic`, several times as fast.
"""

import math
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from common.policy.networks import export_tensors, import_tensors
from services.learner.network.adam import Adam
from services.learner.network.modules import ModulePolicy
from services.learner.network.sparse import SparseRows


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
