"""The network's arithmetic by hand, its initialisation, and parameters in and out."""

import numpy as np
import pytest
import torch

from railctl.common.policy.networks import build_network, dueling_values, export_parameters, import_parameters
from railctl.common.rules.settings import NetworkConfig

PLAIN = NetworkConfig(hidden=(4, 3))
DUELING = NetworkConfig(hidden=(4, 3), kind="dueling")
APART = NetworkConfig(hidden=(4, 3), kind="dueling-apart")


def test_dueling_values_by_hand():
    values = dueling_values(torch.tensor([[1.0], [0.0]]), torch.tensor([[1.0, 2.0, 6.0], [5.0, 5.0, 5.0]]))
    assert values.tolist() == [[-1.0, 0.0, 4.0], [0.0, 0.0, 0.0]]


def test_forward_by_hand():
    network = build_network(NetworkConfig(hidden=(2,)), n_features=1, n_actions=2, seed=0)
    import_parameters(
        network,
        {
            "hidden.0.weight": np.array([[1], [-1]], np.float32),
            "hidden.0.bias": np.array([0, 1], np.float32),
            "q.weight": np.array([[1, 10], [2, 0]], np.float32),
            "q.bias": np.array([0, 5], np.float32),
        },
    )
    # 3 -> relu(3, -2) = (3, 0) -> (3, 11);   -1 -> relu(-1, 2) = (0, 2) -> (20, 5)
    assert network(torch.tensor([[3.0], [-1.0]])).tolist() == [[3, 11], [20, 5]]


def test_dueling_forward_joins_its_heads():
    network = build_network(DUELING, 6, 5, seed=1)
    x = torch.linspace(-1, 0, 12).reshape(2, 6)
    hidden = torch.relu(network.hidden[1](torch.relu(network.hidden[0](x))))
    assert torch.equal(network(x), dueling_values(network.value(hidden), network.advantage(hidden)))
    assert network(x).shape == (2, 5)


def test_dueling_networks_apart_share_nothing():
    network = build_network(APART, 6, 5, seed=1)
    x = torch.linspace(-1, 0, 12).reshape(2, 6)
    advantage = network.advantage(torch.relu(network.advantage_hidden[1](torch.relu(network.advantage_hidden[0](x)))))
    value = network.value(torch.relu(network.value_hidden[1](torch.relu(network.value_hidden[0](x)))))
    assert torch.equal(network(x), dueling_values(value, advantage))
    network(x).mean().backward()  # the mean of the advantages is taken off
    gradients = {name: parameter.grad.abs().max().item() for name, parameter in network.named_parameters()}
    assert all((gradient > 1e-6) == name.startswith("value") for name, gradient in gradients.items())


@pytest.mark.parametrize("config", [PLAIN, DUELING, APART])
def test_initialisation_is_a_function_of_the_seed_alone(config):
    before = torch.get_rng_state()
    first = export_parameters(build_network(config, 6, 5, seed=7))
    assert torch.equal(torch.get_rng_state(), before)
    torch.rand(3)
    again = export_parameters(build_network(config, 6, 5, seed=7))
    other = export_parameters(build_network(config, 6, 5, seed=8))
    assert list(first) == list(again)
    for name, array in first.items():
        np.testing.assert_array_equal(array, again[name])
        assert not np.array_equal(array, other[name])


def test_initialisation_follows_the_law_of_torch():
    network = build_network(NetworkConfig(hidden=(64, 64)), 100, 5, seed=1)
    for layer, n_in in ((network.hidden[0], 100), (network.hidden[1], 64), (network.q, 64)):
        assert layer.weight.abs().max().item() <= n_in**-0.5
        assert layer.bias.abs().max().item() <= n_in**-0.5
    weight = network.hidden[0].weight
    assert weight.abs().max().item() > 0.099  # of at most 0.1, among 6400
    assert abs(weight.std().item() - 0.1 / 3**0.5) < 0.001


@pytest.mark.parametrize("config", [PLAIN, DUELING, APART])
def test_parameters_survive_the_way_out_and_in(config):
    source, target = build_network(config, 6, 5, seed=1), build_network(config, 6, 5, seed=2)
    exported = export_parameters(source)
    for array in exported.values():
        array.flags.writeable = False  # as arrays off a wire are
    import_parameters(target, exported)
    x = torch.linspace(-1, 0, 12).reshape(2, 6)
    assert torch.equal(source(x), target(x))


def test_exported_parameters_are_copies():
    network = build_network(PLAIN, 6, 5, seed=1)
    exported = export_parameters(network)
    exported["q.bias"][:] = 9
    assert not (export_parameters(network)["q.bias"] == 9).any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q.bias": None}, r"tensor q\.bias is missing"),
        ({"r.bias": np.zeros(5, np.float32)}, r"tensor r\.bias is unknown"),
        ({"q.bias": np.zeros(4, np.float32)}, r"tensor q\.bias has shape \(4,\), not \(5,\)"),
        ({"q.bias": np.zeros(5)}, r"tensor q\.bias has dtype float64, not float32"),
    ],
)
def test_what_does_not_fit_is_named_and_changes_nothing(change, message):
    network = build_network(PLAIN, 6, 5, seed=1)
    before = export_parameters(network)
    arrays = {name: array + 1 for name, array in before.items()} | change
    with pytest.raises(ValueError, match=message):
        import_parameters(network, {name: array for name, array in arrays.items() if array is not None})
    for name, array in export_parameters(network).items():
        np.testing.assert_array_equal(array, before[name])
