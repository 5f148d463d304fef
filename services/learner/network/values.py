"""Networks of action values for training that have no update in compiled code (`fused`).

The gradients of the recurrent one are written out; any other module goes the plain path, see `modules`.
"""

from typing import Protocol

from torch import Tensor, nn

from common.policy.networks import dueling_values
from common.policy.recurrent import RecurrentQNetwork
from services.learner.network.layers import RELU, Linear, Stack
from services.learner.network.lstm import Lstm
from services.learner.network.modules import ModuleValues
from services.learner.network.parameters import Parameters
from services.learner.network.sparse import SparseRows


class TrainedValues(Protocol):
    """A copy of a network of action values to train."""

    parameters: Parameters

    def forward(self, x: SparseRows) -> Tensor:
        """Action values [B, A] of observations [B, F], or of the last ones of sequences [L, B, F]."""

    def backward(self, gradient: Tensor) -> None:
        """From the gradient of a loss with respect to the last action values [B, A] to `parameters.flat_gradient`."""


def value_network(network: nn.Module) -> TrainedValues:
    """A copy of a network to train: by written-out gradients if they are known for its class, else by autograd."""
    return RecurrentValues(network) if isinstance(network, RecurrentQNetwork) else ModuleValues(network)


class DuelingHead:
    """`Q = V + A - mean(A)`, see `dueling_values`."""

    def __init__(self, parameters: Parameters) -> None:
        self._value, self._advantage = Linear(parameters, "value"), Linear(parameters, "advantage")

    def forward(self, x: Tensor) -> Tensor:
        """[B, H] to [B, A]."""
        return dueling_values(self._value.forward(x), self._advantage.forward(x))

    def backward(self, gradient: Tensor) -> Tensor:
        """[B, A] to [B, H]."""
        by_value = self._value.backward(gradient.sum(-1, keepdim=True))
        return by_value.add_(self._advantage.backward(gradient - gradient.mean(-1, keepdim=True)))


class RecurrentValues:
    """A copy of a `RecurrentQNetwork` to train: an LSTM, hidden layers over its last state, dueling heads."""

    def __init__(self, network: RecurrentQNetwork) -> None:
        self.parameters = Parameters(network)
        self._lstm = Lstm(self.parameters, "lstm")
        layers = [Linear(self.parameters, f"hidden.{layer}") for layer in range(len(network.hidden))]
        self._hidden = Stack(layers, RELU)
        self._head = DuelingHead(self.parameters)

    def forward(self, x: SparseRows) -> Tensor:
        """Action values [B, A] of the last observations of sequences [L, B, F]."""
        return self._head.forward(self._hidden.forward(self._lstm.forward(x)))

    def backward(self, gradient: Tensor) -> None:
        """From the gradient of a loss with respect to the last action values [B, A] to `parameters.flat_gradient`."""
        self._lstm.backward(self._hidden.backward(self._head.backward(gradient)))
