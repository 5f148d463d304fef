"""Adam over all parameters of a module at once, in the steps of `fused.adam`."""

import numpy as np
import torch
from torch import Tensor

from railctl.services.learner.fused.adam import corrections, move
from railctl.services.learner.textbook.parameters import Parameters


class Adam:
    """Steps along the gradients of `parameters`."""

    def __init__(self, parameters: Parameters, learning_rate: float) -> None:
        self._parameters = parameters
        self.learning_rate = learning_rate
        self._steps = torch.zeros(())
        self._mean = torch.zeros_like(parameters.flat)
        self._square = torch.zeros_like(parameters.flat)

    def step(self) -> None:
        """Move all parameters, by what is in their gradients now."""
        self._steps += 1
        move(
            self._parameters.flat.numpy(),
            self._parameters.flat_gradient.numpy(),
            self._mean.numpy(),
            self._square.numpy(),
            np.float32(1),
            *corrections(self.learning_rate, int(self._steps)),
        )

    def tensors(self) -> dict[str, Tensor]:
        """Views of all that steps change, but the parameters: `steps`, and by parameter `exp_avg/*`, `exp_avg_sq/*`."""
        means, squares = self._parameters.named(self._mean), self._parameters.named(self._square)
        return {
            "steps": self._steps,
            **{f"exp_avg/{name}": tensor for name, tensor in means.items()},
            **{f"exp_avg_sq/{name}": tensor for name, tensor in squares.items()},
        }
