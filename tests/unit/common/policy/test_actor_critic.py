"""Actor and critic: their arithmetic, and orthogonal initialisation from a seed alone."""

import math

import numpy as np
import pytest
import torch

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.networks import export_parameters, import_parameters
from railctl.common.policy.orthogonal import orthogonal
from railctl.common.rules.settings import NetworkConfig

CONFIG = NetworkConfig(hidden=(12, 8))
PINNED = [
    [0.25185948610305786, 0.9300030469894409, 0.2676958739757538],
    [-0.04948461055755615, -0.2638751268386841, 0.9632866382598877],
]


def test_forward_by_hand():
    network = build_actor_critic(NetworkConfig(hidden=(1,)), n_features=1, n_actions=2, seed=0)
    one = np.ones((1, 1), np.float32)
    import_parameters(
        network,
        {
            "actor_hidden.0.weight": 2 * one,
            "actor_hidden.0.bias": np.zeros(1, np.float32),
            "actor.weight": np.array([[1], [3]], np.float32),
            "actor.bias": np.array([0, 1], np.float32),
            "critic_hidden.0.weight": -one,
            "critic_hidden.0.bias": np.ones(1, np.float32),
            "critic.weight": 10 * one,
            "critic.bias": np.zeros(1, np.float32),
        },
    )
    logits, values = network(torch.tensor([[0.5], [1.0]]))
    expected = [[math.tanh(1), 3 * math.tanh(1) + 1], [math.tanh(2), 3 * math.tanh(2) + 1]]
    torch.testing.assert_close(logits, torch.tensor(expected))
    torch.testing.assert_close(values, torch.tensor([10 * math.tanh(0.5), 0.0]))


def test_actor_and_critic_share_nothing():
    network = build_actor_critic(CONFIG, 6, 5, seed=1)
    network.value(torch.randn(4, 6, generator=torch.Generator().manual_seed(0))).sum().backward()
    moved = {name for name, parameter in network.named_parameters() if parameter.grad is not None}
    assert moved == {name for name, _ in network.named_parameters() if name.startswith("critic")}


def test_initialisation_is_a_function_of_the_seed_alone():
    before = torch.get_rng_state()
    first = export_parameters(build_actor_critic(CONFIG, 6, 5, seed=7))
    assert torch.equal(torch.get_rng_state(), before)
    again = export_parameters(build_actor_critic(CONFIG, 6, 5, seed=7))
    other = export_parameters(build_actor_critic(CONFIG, 6, 5, seed=8))
    for name, array in first.items():
        np.testing.assert_array_equal(array, again[name])
        assert name.endswith("bias") or not np.array_equal(array, other[name])


@pytest.mark.parametrize(("name", "gain"), [("actor_hidden.0", 2**0.5), ("critic_hidden.1", 2**0.5), ("actor", 0.01)])
def test_weights_are_orthogonal_with_their_gains_and_biases_zero(name, gain):
    parameters = export_parameters(build_actor_critic(CONFIG, 20, 5, seed=3))
    weight = parameters[f"{name}.weight"].astype(np.float64)
    np.testing.assert_allclose(weight @ weight.T, gain**2 * np.eye(len(weight)), atol=1e-6 * gain**2)
    assert not parameters[f"{name}.bias"].any()


def test_the_first_policy_is_nearly_uniform():
    network = build_actor_critic(NetworkConfig(), 252, 5, seed=1)
    x = -torch.rand(32, 252, generator=torch.Generator().manual_seed(0))
    assert (torch.softmax(network.logits(x), -1) - 0.2).abs().max() < 0.01


@pytest.mark.parametrize(("rows", "columns"), [(5, 9), (9, 5), (7, 7), (1, 4), (1, 1)])
def test_the_shorter_side_of_a_matrix_is_orthonormal(rows: int, columns: int):
    matrix = orthogonal(rows, columns, 1.0, key=5).astype(np.float64)
    assert matrix.shape == (rows, columns)
    product = matrix @ matrix.T if rows <= columns else matrix.T @ matrix
    np.testing.assert_allclose(product, np.eye(min(rows, columns)), atol=1e-6)


def test_initialisation_does_not_change_between_releases():
    assert orthogonal(2, 3, 1.0, key=1).tolist() == PINNED
