"""The recurrent network: states join sequences without a seam, and initialisation depends on the seed alone."""

import numpy as np
import torch

from railctl.common.policy.networks import export_parameters
from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.rules.settings import NetworkConfig

CONFIG = NetworkConfig(hidden=(6, 4))


def test_a_sequence_in_parts_is_the_sequence():
    network = build_recurrent_network(CONFIG, 3, 5, seed=1)
    x = torch.randn(7, 2, 3, generator=torch.Generator().manual_seed(0))
    whole, end = network(x)
    first, state = network(x[:3])
    second, end_of_parts = network(x[3:], state)
    torch.testing.assert_close(torch.cat([first, second]), whole)
    torch.testing.assert_close(end_of_parts, end)
    assert whole.shape == (7, 2, 5)


def test_the_first_state_is_zero():
    network = build_recurrent_network(CONFIG, 3, 5, seed=1)
    x = torch.ones(2, 4, 3)
    assert torch.equal(network(x)[0], network(x, network.zero_state(4))[0])


def test_the_mean_of_the_action_values_is_the_state_value():
    network = build_recurrent_network(CONFIG, 3, 5, seed=1)
    x = torch.ones(1, 1, 3)
    hidden = torch.relu(network.hidden[0](network.lstm(x)[0]))
    torch.testing.assert_close(network(x)[0].mean(-1, keepdim=True), network.value(hidden))


def test_initialisation_is_a_function_of_the_seed_alone():
    before = torch.get_rng_state()
    first = export_parameters(build_recurrent_network(CONFIG, 3, 5, seed=7))
    assert torch.equal(torch.get_rng_state(), before)
    again = export_parameters(build_recurrent_network(CONFIG, 3, 5, seed=7))
    other = export_parameters(build_recurrent_network(CONFIG, 3, 5, seed=8))
    for name, array in first.items():
        np.testing.assert_array_equal(array, again[name])
        assert not np.array_equal(array, other[name])
    assert max(np.abs(array).max() for name, array in first.items() if name.startswith("lstm")) <= 6**-0.5
    assert np.abs(first["hidden.0.weight"]).max() > 0.9 * 6**-0.5
