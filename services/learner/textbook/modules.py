"""The plain path: any torch module and autograd.

A rule may bring a module of its own (`common.policy.modules` acts with it). What trains it is the same: Adam and soft
updates over one flat tensor, of which the module's parameters are views. What is known by its class learns in compiled
code (`fused`); this path costs what autograd costs.
"""

import copy
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from railctl.services.learner.sparse import SparseRows, dense_rows
from railctl.services.learner.textbook.parameters import Parameters


class ModuleBody:
    """A copy of a module whose parameters, and their gradients, are views of two flat tensors."""

    def __init__(self, module: nn.Module, order: Sequence[str] | None = None) -> None:
        """Parameters lie in `order`; None: as the module defines them.

        Raises:
            ValueError: the module keeps more than parameters.
        """
        if buffers := [name for name, _ in module.named_buffers()]:
            raise ValueError(
                f"network: module {type(module).__name__} has buffer {buffers[0]}: only parameters are kept"
            )
        self._module = copy.deepcopy(module)
        self.parameters = Parameters(module, order)
        values = self.parameters.named(self.parameters.flat)
        gradients = self.parameters.named(self.parameters.flat_gradient)
        for name, parameter in self._module.named_parameters():
            parameter.data, parameter.grad = values[name], gradients[name]

    def run(self, x: SparseRows) -> tuple[Tensor, ...]:
        """The module's outputs for observations [..., F], with their graph."""
        with torch.enable_grad():
            out = self._module(torch.tensor(dense_rows(x)))
        return out if isinstance(out, tuple) else (out,)

    def differentiate(self, outputs: Sequence[Tensor], gradients: Sequence[Tensor]) -> None:
        """From the gradients of a loss with respect to outputs to `parameters.flat_gradient`, which is overwritten."""
        self.parameters.flat_gradient.zero_()
        torch.autograd.backward(list(outputs), list(gradients))


class ModuleValues:
    """A module of action values to train: from [B, F] to [B, A].

    From sequences [L, B, F] it gives [L, B, A], and may give its state with them; the last ones count.
    """

    def __init__(self, module: nn.Module) -> None:
        self._body = ModuleBody(module)
        self.parameters = self._body.parameters
        self._values = torch.empty(0)

    def forward(self, x: SparseRows) -> Tensor:
        """Action values [B, A] of observations [B, F], or of the last ones of sequences [L, B, F]."""
        values = self._body.run(x)[0]
        self._values = values[-1] if len(x.shape) == 3 else values
        return self._values.detach()

    def backward(self, gradient: Tensor) -> None:
        """From the gradient of a loss with respect to the last action values [B, A] to `parameters.flat_gradient`."""
        self._body.differentiate([self._values], [gradient])


class ModulePolicy:
    """A module of a policy to train: from [B, F] to logits [B, A] and values [B].

    Attributes:
        parts: what is clipped on its own: actor and critic where they share no parameter, else all.
    """

    def __init__(self, module: nn.Module, n_features: int) -> None:
        actor, critic = (self._reached(module, n_features, output) for output in (0, 1))
        names = [name for name, _ in module.named_parameters()]
        is_apart = not actor & critic
        order = sorted(names, key=lambda name: name in critic) if is_apart else names
        self._body = ModuleBody(module, order)
        self.parameters = self._body.parameters
        first = [name for name in order if name in critic] if is_apart else []
        gradient = self.parameters.flat_gradient
        cut = int(self.parameters.gradient(first[0]).storage_offset()) if first else 0
        self.parts: Sequence[Tensor] = (gradient[:cut], gradient[cut:]) if cut else (gradient,)
        self._outputs: tuple[Tensor, ...] = ()

    @staticmethod
    def _reached(module: nn.Module, n_features: int, output: int) -> set[str]:
        """The parameters that one of the outputs depends on."""
        named = dict(module.named_parameters())
        with torch.enable_grad():
            out = module(torch.zeros(1, n_features))[output].sum()
        gradients = torch.autograd.grad(out, list(named.values()), allow_unused=True)
        return {name for name, gradient in zip(named, gradients, strict=True) if gradient is not None}

    def forward(self, x: SparseRows) -> tuple[Tensor, Tensor]:
        """[B, F] to logits [B, A] and values [B]."""
        logits, value = self._outputs = self._body.run(x)
        return logits.detach(), value.detach()

    def values(self, x: SparseRows) -> Tensor:
        """[B, F] to values [B]."""
        return self._body.run(x)[1].detach()

    def backward(self, by_logits: Tensor, by_value: Tensor) -> None:
        """From the gradients of the last outputs, [B, A] and [B], to those of the parameters."""
        self._body.differentiate(self._outputs, [by_logits, by_value])
