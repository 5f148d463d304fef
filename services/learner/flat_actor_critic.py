"""An actor-critic for training: parameters and gradients in one flat tensor each, the backward pass by hand.

Only a loss on top of the outputs goes through autograd; what is below, two stacks of linear layers with Tanh (`common.
policy.actor_critic`), is a few matrix products into memory that is used again.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.policy.actor_critic import ActorCritic
from common.policy.networks import export_tensors, import_tensors


class Stack:
    """Linear layers with Tanh between them: outputs of a batch, and gradients from those of the outputs."""

    def __init__(self, layers: list[tuple[Tensor, Tensor]], gradients: list[tuple[Tensor, Tensor]]) -> None:
        """Both are pairs of weight [out, in] and bias [out], a layer each; `gradients` are overwritten."""
        self._layers = layers
        self._gradients = gradients
        self._inputs: list[Tensor] = []  # of each layer in the last batch

    def forward(self, x: Tensor) -> Tensor:
        """[B, F] to [B, O]."""
        self._inputs = []
        for index, (weight, bias) in enumerate(self._layers):
            x = torch.tanh_(x) if index else x
            self._inputs.append(x)
            x = torch.addmm(bias, x, weight.T)
        return x

    def backward(self, gradient: Tensor) -> None:
        """Set the gradients of all parameters from that of the last outputs, [B, O]."""
        for index in range(len(self._layers) - 1, -1, -1):
            x = self._inputs[index]
            into_weight, into_bias = self._gradients[index]
            torch.mm(gradient.T, x, out=into_weight)
            torch.sum(gradient, 0, out=into_bias)
            if index:
                gradient = torch.ops.aten.tanh_backward(gradient @ self._layers[index][0], x)


class FlatActorCritic:
    """Trains an actor-critic: `outputs` of a batch, then `descend` on a loss made of them."""

    def __init__(self, network: ActorCritic, learning_rate: float, max_gradient_norm: float) -> None:
        """The parameters start as a copy of those of `network`."""
        named = dict(network.named_parameters())
        sizes = [parameter.numel() for parameter in named.values()]
        self.n_features = network.n_features
        self._limit = max_gradient_norm
        self._parameters = torch.cat([parameter.detach().reshape(-1) for parameter in named.values()])
        self._gradients = torch.zeros_like(self._parameters)
        self._views = _views(self._parameters, named)
        gradients = _views(self._gradients, named)
        self._actor = _stack("actor", self._views, gradients)
        self._critic = _stack("critic", self._views, gradients)
        n_actor = sum(size for name, size in zip(named, sizes, strict=True) if name.startswith("actor"))
        self._shares = (self._gradients[:n_actor], self._gradients[n_actor:])
        self._adam = torch.optim.Adam([self._parameters], lr=learning_rate, fused=True)
        self._moments = {
            "step": torch.zeros(()),
            "exp_avg": torch.zeros_like(self._parameters),
            "exp_avg_sq": torch.zeros_like(self._parameters),
        }
        self._adam.state[self._parameters] = self._moments
        self._parameters.grad = self._gradients
        self._outputs: tuple[Tensor, Tensor]

    @torch.no_grad()
    def outputs(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Logits [B, A] and values [B] of observations [B, F], as leaves of autograd; valid until `descend`."""
        logits, value = self._actor.forward(observation), self._critic.forward(observation).squeeze(-1)
        self._outputs = logits.requires_grad_(), value.requires_grad_()
        return self._outputs

    @torch.no_grad()
    def values(self, observation: Tensor) -> Tensor:
        """Values [B] of observations [B, F]."""
        return self._critic.forward(observation).squeeze(-1)

    def descend(self, loss: Tensor) -> float:
        """A step of Adam on a loss of the last `outputs`, the gradients of actor and critic clipped each.

        Returns:
            The L2 norm of all gradients, before they are clipped.
        """
        into_logits, into_value = torch.autograd.grad(loss, self._outputs)
        with torch.no_grad():
            self._actor.backward(into_logits)
            self._critic.backward(into_value.unsqueeze(-1))
            norms = [torch.linalg.vector_norm(share).item() for share in self._shares]
            for share, norm in zip(self._shares, norms, strict=True):
                if norm > self._limit:
                    share.mul_(self._limit / norm)
            self._adam.step()
        return float(np.hypot(*norms))

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """A copy of the parameters, by the names of `ActorCritic`."""
        return export_tensors(self._views)

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of all that `descend` changes: `network/*` and Adam's moments, which are flat."""
        return export_tensors(self._tensors())

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take on a `state`: all that follows is the same to the bit.

        Raises:
            ValueError: naming the tensor that does not fit; then nothing has changed.
        """
        import_tensors(self._tensors(), state)

    def _tensors(self) -> dict[str, Tensor]:
        moments = {f"adam/{name}": tensor for name, tensor in self._moments.items()}
        return {f"network/{name}": view for name, view in self._views.items()} | moments


def _views(flat: Tensor, named: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Parts of a flat tensor in the order and with the shapes of named ones."""
    parts = torch.split(flat, [tensor.numel() for tensor in named.values()])
    return {name: part.view_as(tensor) for (name, tensor), part in zip(named.items(), parts, strict=True)}


def _stack(name: str, parameters: Mapping[str, Tensor], gradients: Mapping[str, Tensor]) -> Stack:
    layers = [key.removesuffix(".weight") for key in parameters if key.startswith(name) and key.endswith(".weight")]
    pairs = [[(of[f"{layer}.weight"], of[f"{layer}.bias"]) for layer in layers] for of in (parameters, gradients)]
    return Stack(*pairs)
