"""Weights leave the learner in the order in which their twin keeps them."""

import numpy as np
import pytest
from made_networks import first_of, fused_of

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import build_network
from railctl.common.policy.packing import Layout
from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.fused.drqn import FusedDrqn
from railctl.services.learner.fused.packed import VALUES
from railctl.services.learner.fused.policy import FusedPolicy

F, A = 7, 5
DQN = DqnConfig(learning_rate=1e-3, batch_size=8, learn_every_steps=5)

BUILD = {
    "plain": build_network,
    "dueling": build_network,
    "dueling-apart": build_network,
    "actor-critic": build_actor_critic,
    "recurrent": build_recurrent_network,
}


@pytest.mark.parametrize("hidden", [(16, 32), (9, 33, 6), (8,)])
@pytest.mark.parametrize("kind", BUILD)
def test_a_twin_takes_them_over_as_they_are(kind, hidden):
    network = BUILD[kind](NetworkConfig(kind=kind, hidden=hidden), F, A, 1)
    first = first_of(network)
    if kind == "actor-critic":
        trained = FusedPolicy(first, 1e-3, 0.5)
    else:
        trained = FusedDrqn(DQN, first) if kind == "recurrent" else fused_of(DQN, network)
    weights, twin = trained.weights(), Twin(Layout(kind, F, A, hidden))
    assert list(weights) == list(first.weights)
    for name, array in first.weights.items():
        np.testing.assert_array_equal(weights[name], array)
    twin.load(weights)
    assert twin.parameters is weights.flat
    twin.load(first.weights)
    assert twin.parameters.tobytes() == weights.flat.tobytes()  # with zeros where there are no weights
    trained.arrays[VALUES] += 1
    assert twin.parameters.tobytes() == weights.flat.tobytes()
