"""The networks of action values for training: what `common.policy.networks` and `recurrent` define, with gradients.

An entry takes observations in, hidden layers follow, a head gives the action values. Any other module goes the plain
path, see `modules`.
"""

from typing import Protocol

from torch import Tensor, nn

from common.policy.networks import QNetwork, dueling_values
from common.policy.recurrent import RecurrentQNetwork
from services.learner.network.layers import RELU, Linear, Perceptron, Stack
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
    """A copy of a network to train: on the fast path if there is one for its class."""
    if isinstance(network, (QNetwork, RecurrentQNetwork)):
        return ValueNetwork(network)
    return ModuleValues(network)


class Body(Protocol):
    """Everything below the head."""

    def forward(self, x: SparseRows) -> Tensor:
        """Observations to [B, H]."""

    def backward(self, gradient: Tensor) -> None:
        """Of [B, H], overwritten."""


class Head(Protocol):
    """From the last hidden layer to action values."""

    def forward(self, x: Tensor) -> Tensor:
        """[B, H] to [B, A]."""

    def backward(self, gradient: Tensor) -> Tensor:
        """[B, A] to [B, H]."""


class RecurrentBody:
    """An LSTM, then hidden layers over its last state."""

    def __init__(self, lstm: Lstm, hidden: Stack) -> None:
        self._lstm, self._hidden = lstm, hidden

    def forward(self, x: SparseRows) -> Tensor:
        """[L, B, F] to [B, H]."""
        return self._hidden.forward(self._lstm.forward(x))

    def backward(self, gradient: Tensor) -> None:
        """Of [B, H], overwritten."""
        self._lstm.backward(self._hidden.backward(gradient))


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


class ValueNetwork:
    """A copy of a `QNetwork` or a `RecurrentQNetwork` to train."""

    def __init__(self, network: nn.Module) -> None:
        self.parameters = Parameters(network)
        names = [name for name, _ in network.named_parameters()]
        depth = sum(name.startswith("hidden.") for name in names) // 2
        self._body: Body
        if "lstm.weight_ih_l0" in names:
            hidden = Stack([Linear(self.parameters, f"hidden.{layer}") for layer in range(depth)], RELU)
            self._body = RecurrentBody(Lstm(self.parameters, "lstm"), hidden)
        else:
            self._body = Perceptron(self.parameters, "hidden", depth, RELU)
        is_dueling = "value.weight" in names
        self._head: Head = DuelingHead(self.parameters) if is_dueling else Linear(self.parameters, "q")

    def forward(self, x: SparseRows) -> Tensor:
        """Action values [B, A] of observations [B, F], or of the last ones of sequences [L, B, F]."""
        return self._head.forward(self._body.forward(x))

    def backward(self, gradient: Tensor) -> None:
        """From the gradient of a loss with respect to the last action values [B, A] to `parameters.flat_gradient`."""
        self._body.backward(self._head.backward(gradient))
