"""A network that sees the exits of a `traffic` observation: one encoder for all, attention over the other trains.

What is said of an exit, and of the train, is encoded; so is what is said of each other train behind this exit. The exit
asks the others by scaled dot products, which softmax turns into weights (Vaswani et al., "Attention Is All You Need",
2017, arXiv:1706.03762; one head, keys and values are the same), and takes the weighted mean along. Shared hidden layers
make of it the exit's logit. The means and the maxima of the exits, with what is said of the train, make the logits of
doing nothing and of stopping, and the state's value. An exit that is not there has a fixed logit, so low that it is
hardly ever taken where nobody forbids it. All activations are Tanh.

With `hidden` (h, a, ..., z) encoders have h units, the hidden layers are 2h -> a -> ... -> z; a single width counts
twice.
"""

import math

import torch
from torch import Tensor, nn

from railctl.common.policy.exit_layers import NO_EXIT, exit_layers
from railctl.common.policy.first_weights import first_exits
from railctl.common.policy.networks import import_parameters, linear_layer
from railctl.common.rail.observations.traffic_shape import N_EXIT, N_EXITS, N_MEETING, N_OTHER, N_TRAIN
from railctl.common.rules.settings import NetworkConfig

FAR_BELOW = -1e9  # a score whose weight is 0


class ExitsNetwork(nn.Module):
    """Logits of the actions and the values of a batch of `traffic` observations.

    Parameters in order: `exit.weight|bias`, `row.*`, `query.*`, `shared.<i>.*`, `move.*`, `pooled.*`, `stay.*`,
    `value.*`. They are uninitialised: use `build_exits`.
    """

    def __init__(self, n_features: int, n_actions: int, config: NetworkConfig) -> None:
        super().__init__()
        self.n_features = n_features
        self.n_actions = n_actions
        layers = {layer.name: linear_layer(layer.n_in, layer.n_out) for layer in exit_layers(config.hidden)}
        self.exit, self.row, self.query = layers["exit"], layers["row"], layers["query"]
        self.shared = nn.ModuleList(layer for name, layer in layers.items() if name.startswith("shared."))
        self.move, self.pooled, self.stay, self.value = (layers[name] for name in ("move", "pooled", "stay", "value"))

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """[B, F] float32 to logits [B, 5] and values [B]."""
        train, exits, others = parts(observation)
        there = exits[..., 0] > 0
        code = torch.tanh(self.exit(torch.cat([train.unsqueeze(1).expand(-1, N_EXITS, -1), exits], -1)))
        x = torch.cat([code, self._attend(code, others)], -1)
        for layer in self.shared:
            x = torch.tanh(layer(x))
        moves = self.move(x).squeeze(-1).masked_fill(~there, NO_EXIT)
        mean = (x * there.unsqueeze(-1)).sum(1) / there.sum(1, keepdim=True).clamp(min=1)
        most = x.masked_fill(~there.unsqueeze(-1), -1).amax(1) * there.any(1, keepdim=True)
        pooled = torch.tanh(self.pooled(torch.cat([mean, most, train], -1)))
        stays, value = self.stay(pooled), self.value(pooled)
        return torch.cat([stays[:, :1], moves, stays[:, 1:]], -1), value.squeeze(-1)

    def _attend(self, code: Tensor, others: Tensor) -> Tensor:
        """[B, 3, h]: what each exit takes along of the others [B, 3, R, 25]; zeros if there are none."""
        rows = torch.tanh(self.row(others))
        present = others[..., 0] > 0
        scores = (rows @ self.query(code).unsqueeze(-1)).squeeze(-1) / math.sqrt(code.shape[-1])
        weights = torch.softmax(scores.masked_fill(~present, FAR_BELOW), -1) * present
        return (weights.unsqueeze(-2) @ rows).squeeze(-2)


def parts(observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The parts of `traffic` observations [B, F]: train [B, 13], exits [B, 3, 16], others [B, 3, R, 25]."""
    end = N_TRAIN + N_EXITS * N_EXIT
    train, exits = observation[:, :N_TRAIN], observation[:, N_TRAIN:end].reshape(-1, N_EXITS, N_EXIT)
    rows = observation[:, end:].reshape(len(observation), -1, N_OTHER + N_EXITS * N_MEETING)
    common = rows[..., :N_OTHER].unsqueeze(1).expand(-1, N_EXITS, -1, -1)
    meetings = rows[..., N_OTHER:].reshape(*rows.shape[:2], N_EXITS, N_MEETING).transpose(1, 2)
    return train, exits, torch.cat([common, meetings], -1)


def build_exits(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> ExitsNetwork:
    """A network whose parameters are a function of `seed` alone, on every machine; see `first_weights`."""
    network = ExitsNetwork(n_features, n_actions, config)
    import_parameters(network, first_exits(config, n_features, n_actions, seed).weights)
    return network
