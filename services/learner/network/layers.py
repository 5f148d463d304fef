"""Layers with their gradients written out, over memory that is used again: no graph is built.

A layer's `forward` writes into its own memory, valid until the next; its `backward` wants the gradient of the loss with
respect to what the last `forward` gave, and writes those of its parameters. Shapes: B rows, layers of I inputs and H
outputs.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.kernel import bare_kernel
from services.learner.network.parameters import Parameters


class Memory:
    """Room for [..., width] float32, kept from call to call."""

    def __init__(self, width: int) -> None:
        self._tensor = torch.empty(0, width)

    def of(self, *rows: int) -> Tensor:
        """[*rows, width]: the same memory if the rows are as many as before."""
        if self._tensor.shape[:-1] != rows:
            self._tensor = torch.empty(*rows, self._tensor.shape[-1])
        return self._tensor


class Activation(NamedTuple):
    """A function in place, and its gradient.

    Attributes:
        apply: of a tensor, in place; gives that tensor.
        differentiate: from what came out and the gradient of that to the gradient of what went in, in place.
    """

    apply: Callable[[Tensor], Tensor]
    differentiate: Callable[[Tensor, Tensor], None]


@bare_kernel
def stop_where_zero(y: NDArray[np.float32], gradient: NDArray[np.float32]) -> None:
    """The gradient [n] of ReLU's inputs, from its outputs and their gradient."""
    for i in range(len(y)):
        gradient[i] = gradient[i] if y[i] > np.float32(0) else np.float32(0)


def tanh_(x: Tensor) -> Tensor:
    """Tanh in place, as `2 sigmoid(2 x) - 1`: several times as fast as torch's own here, and as exact as sums."""
    return x.mul_(2).sigmoid_().mul_(2).sub_(1)


RELU = Activation(torch.relu_, lambda y, gradient: stop_where_zero(y.view(-1).numpy(), gradient.view(-1).numpy()))


class Linear:
    """y = x W + b."""

    def __init__(self, parameters: Parameters, name: str) -> None:
        """Its parameters are `name`.weight and `name`.bias."""
        self._weight, self._bias = parameters.value(f"{name}.weight"), parameters.value(f"{name}.bias")
        self._weight_gradient = parameters.gradient(f"{name}.weight")
        self._bias_gradient = parameters.gradient(f"{name}.bias")
        self._x = torch.empty(0)
        self._out, self._x_gradient = Memory(len(self._bias)), Memory(len(self._weight))

    def forward(self, x: Tensor) -> Tensor:
        """[B, I] to [B, H]."""
        self._x = x
        return torch.addmm(self._bias, x, self._weight, out=self._out.of(len(x)))

    def backward(self, gradient: Tensor) -> Tensor:
        """[B, H] to the gradient of the inputs [B, I]."""
        torch.mm(self._x.t(), gradient, out=self._weight_gradient)
        torch.sum(gradient, 0, out=self._bias_gradient)
        return torch.mm(gradient, self._weight.t(), out=self._x_gradient.of(len(gradient)))


class Stack:
    """Hidden layers, an activation after each."""

    def __init__(self, layers: Sequence[Linear], activation: Activation) -> None:
        self._layers, self._activation = layers, activation
        self._outs: list[Tensor] = []

    def forward(self, x: Tensor) -> Tensor:
        """[B, I] to [B, H]."""
        self._outs = []
        for layer in self._layers:
            x = self._activation.apply(layer.forward(x))
            self._outs.append(x)
        return x

    def backward(self, gradient: Tensor) -> Tensor:
        """[B, H], overwritten, to the gradient of the inputs [B, I]."""
        for layer, out in zip(reversed(self._layers), reversed(self._outs), strict=True):
            self._activation.differentiate(out, gradient)
            gradient = layer.backward(gradient)
        return gradient
