"""A network's parameters as views of one flat tensor, and their gradients as views of another.

So what is done to all of them is one call: a step of Adam, a norm, a soft update. Weights lie transposed, a row an
input, so that an input of zero leaves out a whole row (as in `common.policy.packing`); those of heads, which are
narrow, lie as torch has them, since its products are twice as fast so. Every view begins on a cache line: torch's
kernels give the same bits for the same numbers only at the same alignment. The gaps stay zero.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

LINE = 16  # float32 numbers of a cache line


class Parameters:
    """A copy of the parameters of `network`, and room for their gradients."""

    def __init__(self, network: nn.Module, order: Sequence[str] | None = None) -> None:
        """They lie in `order`; None: as the network defines them."""
        parameters = dict(network.named_parameters())
        self._shapes = {name: parameters[name].shape for name in order or parameters}
        self._starts: dict[str, int] = {}
        length = 0
        for name, shape in self._shapes.items():
            self._starts[name] = length
            length += -(-shape.numel() // LINE) * LINE
        self.flat, self.flat_gradient = torch.zeros(length), torch.zeros(length)
        for name, view in self.named(self.flat).items():
            view.copy_(parameters[name].detach())

    def named(self, flat: Tensor) -> dict[str, Tensor]:
        """Views of a tensor like `flat` with the names and shapes that they have in the network."""
        return {name: self._view(flat, name) for name in self._shapes}

    def value(self, name: str) -> Tensor:
        """The view of a parameter: weights [in, out], biases [out]."""
        return _turned(self._view(self.flat, name))

    def gradient(self, name: str) -> Tensor:
        """The view of a parameter's gradient, as `value`."""
        return _turned(self._view(self.flat_gradient, name))

    def _view(self, flat: Tensor, name: str) -> Tensor:
        """With the shape that it has in the network."""
        start, shape = self._starts[name], self._shapes[name]
        part = flat[start : start + shape.numel()]
        return part.view(*reversed(shape)).t() if len(shape) == 2 and shape[0] >= LINE else part.view(shape)


def _turned(view: Tensor) -> Tensor:
    return view.t() if view.ndim == 2 else view
