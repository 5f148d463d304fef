"""Layers and their written-out gradients against torch's own, and a step of Adam against torch's."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from common.policy.networks import build_network, linear_layer
from common.policy.recurrent import build_recurrent_network
from common.rules.settings import NetworkConfig
from services.learner.network.adam import Adam
from services.learner.network.layers import RELU
from services.learner.network.parameters import LINE, Parameters
from services.learner.network.sparse import sparse_rows
from services.learner.network.values import RecurrentValues

F, A = 21, 3


def observations(*rows, density=0.2, seed=1):
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(*rows, F, generator=generator)
    return x * (torch.rand(x.shape, generator=generator) < density)


def assert_same_gradients(parameters, network):
    ours = parameters.named(parameters.flat_gradient)
    for name, parameter in network.named_parameters():
        torch.testing.assert_close(ours[name], parameter.grad, rtol=1e-4, atol=1e-6, msg=name)


def run_each_from_its_start(network, x, starts):
    """The last action values [B, A] of sequences that begin at different steps."""
    return torch.cat([network(x[start:, [row]])[0][-1] for row, start in enumerate(starts)])


@pytest.mark.parametrize(("hidden", "length"), [((8, 7), 5), ((9,), 3), ((8, 8), 1)])
def test_a_recurrent_network_and_its_gradients_are_those_of_torch(hidden, length):
    network = build_recurrent_network(NetworkConfig(kind="recurrent", hidden=hidden), F, A, seed=1)
    ours = RecurrentValues(network)
    starts = [min(start, length - 1) for start in (0, 1, 2, 4)]
    x = observations(length, len(starts), density=0.6)
    for row, start in enumerate(starts):
        x[:start, row] = 0
        x[start + 1 : start + 2, row] = 0  # nothing seen later on is seen nevertheless
    theirs = run_each_from_its_start(network, x, starts)
    torch.testing.assert_close(ours.forward(sparse_rows(x)), theirs.detach(), rtol=1e-5, atol=1e-6)
    by_q = torch.randn(len(starts), A, generator=torch.Generator().manual_seed(2))
    theirs.backward(by_q)
    ours.backward(by_q)
    assert_same_gradients(ours.parameters, network)


@settings(deadline=None)
@given(st.integers(0, 6), st.integers(1, 40), st.floats(0, 1), st.integers(0, 2**31))
def test_sparse_rows_hold_what_is_not_zero(rows, columns, density, seed):
    generator = np.random.default_rng(seed)
    x = generator.standard_normal((rows, columns), np.float32) * (generator.random((rows, columns)) < density)
    sparse = sparse_rows(torch.tensor(x, dtype=torch.float32))
    assert sparse.shape == (rows, columns)
    assert sparse.n_rows == rows
    for row, (first, last) in enumerate(zip(sparse.starts[:-1], sparse.starts[1:], strict=True)):
        assert sparse.columns[first:last].tolist() == np.flatnonzero(x[row]).tolist()
        assert sparse.values[first:last].tolist() == x[row][x[row] != 0].tolist()


def test_parameters_are_a_copy_in_aligned_views():
    network = build_network(NetworkConfig(hidden=(5, 3)), F, A, seed=1)
    parameters = Parameters(network)
    for name, parameter in network.named_parameters():
        view = parameters.named(parameters.flat)[name]
        assert torch.equal(view, parameter)
        assert torch.equal(parameters.value(name), parameter.t())
        assert view.storage_offset() % LINE == 0
    parameters.value("q.bias")[:] = 7
    assert (parameters.flat == 7).sum() == A
    assert not (network.q.bias == 7).any()


def test_relu_lets_the_gradient_through_where_it_let_the_value_through():
    x = torch.tensor([[-1.0, 2.0, 0.0]])
    gradient = torch.tensor([[5.0, 6.0, 7.0]])
    RELU.differentiate(RELU.apply(x), gradient)
    assert gradient.tolist() == [[0, 6, 0]]


def test_adam_by_hand():
    layer = linear_layer(1, 1)
    nn.init.constant_(layer.weight, 3.0)
    nn.init.constant_(layer.bias, 3.0)
    parameters = Parameters(layer)
    adam = Adam(parameters, 0.1)
    parameters.gradient("weight")[:] = 2
    adam.step()  # the first step goes by the sign of the gradient alone
    assert parameters.value("weight").item() == pytest.approx(2.9)
    assert parameters.value("bias").item() == 3
    parameters.gradient("weight")[:] = -1
    adam.step()
    # Moments 0.1 * 2 * 0.9 - 0.1 = 0.08 of 1 - 0.81, and 0.001 * (4 * 0.999 + 1) = 0.004996 of 1 - 0.998001.
    assert parameters.value("weight").item() == pytest.approx(2.9 - 0.1 * (0.08 / 0.19) / (0.004996 / 0.001999) ** 0.5)
    assert adam.tensors()["steps"].item() == 2


def test_adam_moves_as_that_of_torch():
    network = build_network(NetworkConfig(hidden=(5, 3)), F, A, seed=1)
    parameters = Parameters(network)
    ours, theirs = Adam(parameters, 0.01), torch.optim.Adam(network.parameters(), 0.01)
    generator = torch.Generator().manual_seed(1)
    for _ in range(20):
        for name, parameter in network.named_parameters():
            parameter.grad = torch.randn(parameter.shape, generator=generator)
            parameters.named(parameters.flat_gradient)[name].copy_(parameter.grad)
        ours.step()
        theirs.step()
    for name, parameter in network.named_parameters():
        torch.testing.assert_close(parameters.named(parameters.flat)[name], parameter.detach(), rtol=1e-5, atol=1e-6)
