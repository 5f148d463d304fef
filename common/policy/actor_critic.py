"""Actor and critic: what to do, and what a state is worth. They share nothing but their input.

Source: section 4.3 of "Deep Reinforcement Learning in the Flatland Multi-Agent Environment" (2021): both have the same
hidden layers with Tanh; the actor's outputs go through a softmax, the critic has one; orthogonal initialisation. The
gains are ours, after Engstrom et al., "Implementation Matters in Deep Policy Gradients" (2020, arXiv:2005.12729):
sqrt(2) for hidden layers, 0.01 for the actor's head, so that the first policy is nearly uniform, and 1 for the
critic's; biases are zero.
"""

import itertools

import torch
from torch import Tensor, nn

from railctl.common.policy.first_weights import first_actor_critic
from railctl.common.policy.networks import import_parameters, linear_layer
from railctl.common.rules.settings import NetworkConfig


class ActorCritic(nn.Module):
    """Logits of the actions and the values of a batch of observations.

    Parameters in order: `actor_hidden.<i>.weight|bias`, `actor.*`, `critic_hidden.<i>.*`, `critic.*`. They are
    uninitialised: use `build_actor_critic`.
    """

    def __init__(self, n_features: int, n_actions: int, config: NetworkConfig) -> None:
        super().__init__()
        self.n_features = n_features
        self.n_actions = n_actions
        widths = (n_features, *config.hidden)
        self.actor_hidden = nn.ModuleList(linear_layer(n_in, n_out) for n_in, n_out in itertools.pairwise(widths))
        self.actor = linear_layer(widths[-1], n_actions)
        self.critic_hidden = nn.ModuleList(linear_layer(n_in, n_out) for n_in, n_out in itertools.pairwise(widths))
        self.critic = linear_layer(widths[-1], 1)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """[B, F] float32 to logits [B, A] and values [B]."""
        return self.logits(observation), self.value(observation)

    def logits(self, observation: Tensor) -> Tensor:
        """[B, F] to [B, A]: softmax makes probabilities of them."""
        x = observation
        for layer in self.actor_hidden:
            x = torch.tanh(layer(x))
        logits: Tensor = self.actor(x)
        return logits

    def value(self, observation: Tensor) -> Tensor:
        """[B, F] to [B]."""
        x = observation
        for layer in self.critic_hidden:
            x = torch.tanh(layer(x))
        value: Tensor = self.critic(x)
        return value.squeeze(-1)


def build_actor_critic(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> ActorCritic:
    """An actor-critic whose parameters are a function of `seed` alone, on every machine; see `first_weights`."""
    network = ActorCritic(n_features, n_actions, config)
    import_parameters(network, first_actor_critic(config, n_features, n_actions, seed).weights)
    return network
