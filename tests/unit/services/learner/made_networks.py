"""Networks of torch as what runs begin with."""

from common.policy.first_weights import FirstNetwork
from common.policy.networks import QNetwork, export_parameters
from common.policy.recurrent import RecurrentQNetwork
from common.rules.settings import NetworkConfig


def first_of(network) -> FirstNetwork:
    """A copy of a network as it is."""
    if isinstance(network, QNetwork):
        kind, hidden = "dueling" if network.dueling else "plain", network.hidden
    elif isinstance(network, RecurrentQNetwork):
        kind, hidden = "recurrent", network.hidden
    else:
        kind, hidden = "actor-critic", network.actor_hidden
    widths = tuple(layer.out_features for layer in hidden)
    if kind == "recurrent":
        widths = (network.lstm.hidden_size, *widths)
    config = NetworkConfig(kind=kind, hidden=widths)
    return FirstNetwork(network.n_features, network.n_actions, config, export_parameters(network))
