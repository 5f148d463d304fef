"""Sparse rows, parameters that lie flat, and a step of Adam against torch's."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from railctl.common.policy.networks import build_network, linear_layer
from railctl.common.rules.settings import NetworkConfig
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.adam import Adam
from railctl.services.learner.textbook.parameters import LINE, Parameters

F, A = 21, 3


@settings(deadline=None)
@given(st.integers(0, 6), st.integers(1, 40), st.floats(0, 1), st.integers(0, 2**31))
def test_sparse_rows_hold_what_is_not_zero(rows, columns, density, seed):
    generator = np.random.default_rng(seed)
    x = generator.standard_normal((rows, columns), np.float32) * (generator.random((rows, columns)) < density)
    sparse = sparse_rows(x.astype(np.float32))
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
