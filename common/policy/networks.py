"""The Q-network that all trains share, its seeded initialisation, and its parameters as plain arrays.

Hidden layers with ReLU, then either one linear layer of action values or the two dueling heads of Wang et
al., "Dueling Network Architectures for Deep RL" (2016, arXiv:1511.06581). As there, the heads share the
hidden layers; of the kind `dueling-apart` they are two networks that share only their input, V(s; theta_1) and
A(s, a; theta_2) in section 4.2 of the study.

Parameters leave and enter as `dict[str, float32 array]`. They enter by copy into memory that torch allocated:
the results of torch's kernels can differ in the last bit with the alignment of their inputs, and the memory
of an array that came off a wire or out of a file lies anywhere.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from railctl.common.policy.first_weights import first_values
from railctl.common.policy.named import check_fit, copies
from railctl.common.rules.settings import NetworkConfig


def dueling_values(value: Tensor, advantage: Tensor) -> Tensor:
    """Action values from a state's value and its actions' advantages: `Q = V + A - mean(A)`.

    Equations 2.19 and 4.2 of the study; equation 9 of Wang et al. 2016. The mean pins down a split that Q alone leaves
    open.

    Args:
        value: [B, 1].
        advantage: [B, A].

    Returns:
        [B, A].
    """
    return value + advantage - advantage.mean(-1, keepdim=True)


class QNetwork(nn.Module):
    """The action values of a batch of observations.

    Parameters in order: `hidden.<i>.weight|bias`, then `q.*`, or `value.*` and `advantage.*` if dueling; if those are
    apart, `advantage_hidden.<i>.*`, `advantage.*`, `value_hidden.<i>.*` and `value.*`. They are uninitialised: use
    `build_network`.
    """

    def __init__(self, n_features: int, n_actions: int, config: NetworkConfig) -> None:
        super().__init__()
        self.n_features = n_features
        self.n_actions = n_actions
        self.config = config
        widths = (n_features, *config.hidden)
        if config.kind == "dueling-apart":
            self.advantage_hidden = linear_layers(widths)
            self.advantage = linear_layer(widths[-1], n_actions)
            self.value_hidden = linear_layers(widths)
            self.value = linear_layer(widths[-1], 1)
            return
        self.hidden = linear_layers(widths)
        if config.kind == "dueling":
            self.value = linear_layer(widths[-1], 1)
            self.advantage = linear_layer(widths[-1], n_actions)
        else:
            self.q = linear_layer(widths[-1], n_actions)

    def forward(self, observation: Tensor) -> Tensor:
        """[B, F] float32 to [B, A] float32."""
        if self.config.kind == "dueling-apart":
            value = self.value(rectified(self.value_hidden, observation))
            return dueling_values(value, self.advantage(rectified(self.advantage_hidden, observation)))
        x = rectified(self.hidden, observation)
        if self.config.kind == "dueling":
            return dueling_values(self.value(x), self.advantage(x))
        q: Tensor = self.q(x)
        return q


def rectified(layers: Iterable[nn.Module], x: Tensor) -> Tensor:
    """What comes out of layers with ReLU behind each."""
    for layer in layers:
        x = torch.relu(layer(x))
    return x


def build_network(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> QNetwork:
    """A network whose parameters are a function of `seed` alone, on every machine; see `first_weights`."""
    network = QNetwork(n_features, n_actions, config)
    import_parameters(network, first_values(config, n_features, n_actions, seed).weights)
    return network


def export_parameters(network: nn.Module) -> dict[str, NDArray[np.float32]]:
    """A copy of every parameter, by name, in the order of definition."""
    return export_tensors(dict(network.named_parameters()))


def import_parameters(network: nn.Module, arrays: Mapping[str, NDArray[np.float32]]) -> None:
    """Overwrite the parameters of `network` in place.

    Raises:
        ValueError: naming the first tensor that is missing, unknown, or of another dtype or shape; then
            nothing has changed.
    """
    import_tensors(dict(network.named_parameters()), arrays)


def export_tensors(tensors: Mapping[str, Tensor]) -> dict[str, NDArray[np.float32]]:
    """A copy of each float32 tensor, which lies in memory as the tensor does."""
    return copies({name: tensor.detach().numpy() for name, tensor in tensors.items()})


def import_tensors(tensors: Mapping[str, Tensor], arrays: Mapping[str, NDArray[np.float32]]) -> None:
    """Overwrite each tensor in place with the array of its name; raises as `import_parameters`."""
    check_fit({name: tuple(tensor.shape) for name, tensor in tensors.items()}, arrays)
    with torch.no_grad():
        for name, tensor in tensors.items():
            tensor.copy_(torch.tensor(arrays[name]))


def linear_layers(widths: Sequence[int]) -> nn.ModuleList:
    """Those between these widths, as `linear_layer` makes them."""
    return nn.ModuleList(linear_layer(n_in, n_out) for n_in, n_out in itertools.pairwise(widths))


def linear_layer(n_in: int, n_out: int) -> nn.Linear:
    """A layer with memory but no values: the usual constructor would draw from torch's global generator."""
    return _Unset(n_in, n_out)


class _Unset(nn.Linear):
    """As `nn.utils.skip_init` makes it, which takes half a second for torch's symbolic shapes."""

    def reset_parameters(self) -> None:
        """Draws nothing."""
