"""The recurrent Q-network: an LSTM in place of the first layer, then as the dueling network.

Source: "Deep Recurrent Q-Learning for Partially Observable MDPs", Hausknecht & Stone (2015, arXiv:1507.06527), as in
section 4.2 of "Deep Reinforcement Learning in the Flatland Multi-Agent Environment" (2021): while acting, a train
carries its hidden state from decision to decision, zero at first; training runs over sequences from a zero state.
"""

import itertools

import torch
from torch import Tensor, nn

from railctl.common.policy.first_weights import first_recurrent
from railctl.common.policy.networks import dueling_values, import_parameters, linear_layer
from railctl.common.rules.settings import NetworkConfig

State = tuple[Tensor, Tensor]  # hidden and cell state, [B, H] each


class RecurrentQNetwork(nn.Module):
    """The action values along a batch of sequences of observations.

    The first of `config.hidden` is the LSTM's width. Parameters in order: `lstm.weight_ih_l0`, `lstm.weight_hh_l0`,
    `lstm.bias_ih_l0`, `lstm.bias_hh_l0`, `hidden.<i>.weight|bias`, `value.*`, `advantage.*`. They are uninitialised:
    use `build_recurrent_network`.
    """

    def __init__(self, n_features: int, n_actions: int, config: NetworkConfig) -> None:
        super().__init__()
        self.n_features = n_features
        self.n_actions = n_actions
        self.lstm = nn.LSTM(n_features, config.hidden[0], device="meta").to_empty(device="cpu")
        self.hidden = nn.ModuleList(linear_layer(n_in, n_out) for n_in, n_out in itertools.pairwise(config.hidden))
        self.value = linear_layer(config.hidden[-1], 1)
        self.advantage = linear_layer(config.hidden[-1], n_actions)

    def zero_state(self, batch: int) -> State:
        """The state before the first observation of each of `batch` sequences."""
        nothing = self.lstm.get_parameter("weight_hh_l0").new_zeros(batch, self.lstm.hidden_size)
        return nothing, nothing

    def forward(self, observation: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """Run along sequences.

        Args:
            observation: [T, B, F].
            state: before the first step; zero if not given.

        Returns:
            Action values [T, B, A], and the state after the last step.
        """
        hidden, cell = self.zero_state(observation.shape[1]) if state is None else state
        x, (last_hidden, last_cell) = self.lstm(observation, (hidden[None], cell[None]))
        for layer in self.hidden:
            x = torch.relu(layer(x))
        return dueling_values(self.value(x), self.advantage(x)), (last_hidden[0], last_cell[0])


def build_recurrent_network(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> RecurrentQNetwork:
    """A network whose parameters are a function of `seed` alone, on every machine; see `first_weights`."""
    network = RecurrentQNetwork(n_features, n_actions, config)
    import_parameters(network, first_recurrent(config, n_features, n_actions, seed).weights)
    return network
