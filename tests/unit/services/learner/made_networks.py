"""Networks of torch as what runs begin with, and what learns them."""

from railctl.common.policy.first_weights import FirstNetwork
from railctl.common.policy.networks import QNetwork, export_parameters
from railctl.common.policy.recurrent import RecurrentQNetwork
from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.fused.dqn import FusedApart, FusedDqn, FusedValues


def first_of(network) -> FirstNetwork:
    """A copy of a network as it is."""
    if isinstance(network, QNetwork):
        return FirstNetwork(network.n_features, network.n_actions, network.config, export_parameters(network))
    if isinstance(network, RecurrentQNetwork):
        kind, hidden = "recurrent", network.hidden
    else:
        kind, hidden = "actor-critic", network.actor_hidden
    widths = tuple(layer.out_features for layer in hidden)
    if kind == "recurrent":
        widths = (network.lstm.hidden_size, *widths)
    config = NetworkConfig(kind=kind, hidden=widths)
    return FirstNetwork(network.n_features, network.n_actions, config, export_parameters(network))


def fused_of(config: DqnConfig, network: QNetwork) -> FusedValues:
    """What learns a copy of a network in compiled code."""
    learner = FusedApart if network.config.kind == "dueling-apart" else FusedDqn
    return learner(config, first_of(network))
