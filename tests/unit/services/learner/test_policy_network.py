"""A policy that learns by a loss of its own beside autograd and Adam on the same network."""

import numpy as np
import pytest
import torch

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.networks import export_parameters
from railctl.common.rules.settings import NetworkConfig
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.policies import PolicyNetwork

FEATURES, ACTIONS = 6, 3


def make_network(hidden=(8, 5)):
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=hidden), FEATURES, ACTIONS, seed=1)
    with torch.no_grad():  # heads as large as anything else, so that every gradient is
        network.actor.weight.mul_(100)
    return network


def batches(count, size=10):
    generator = torch.Generator().manual_seed(1)
    return [-torch.rand(size, FEATURES, generator=generator).numpy() for _ in range(count)]


def some_loss(logits, value, scale=1.0):
    return scale * (torch.log_softmax(logits, -1)[:, 1].mean() + (value - 0.3).square().mean())


@pytest.mark.parametrize("hidden", [(8,), (8, 5), (8, 5, 7)])
def test_steps_are_those_of_autograd_and_adam(hidden):
    network = make_network(hidden)
    flat = PolicyNetwork(network, learning_rate=0.01, max_gradient_norm=1e9)
    adam = torch.optim.Adam(network.parameters(), lr=0.01)
    for batch in batches(5):
        logits, value = flat.outputs(sparse_rows(batch))
        expected_logits, expected_value = network(torch.tensor(batch))
        torch.testing.assert_close(logits, expected_logits)
        torch.testing.assert_close(value, expected_value)
        norm = flat.descend(some_loss(logits, value))
        adam.zero_grad()
        some_loss(expected_logits, expected_value).backward()
        expected_norm = torch.nn.utils.get_total_norm([p.grad for p in network.parameters()])
        assert norm == pytest.approx(expected_norm.item(), rel=1e-5)
        adam.step()
    for name, array in export_parameters(network).items():
        np.testing.assert_allclose(flat.weights()[name], array, atol=1e-5, err_msg=name)


def test_gradients_of_actor_and_critic_are_clipped_each():
    network = make_network()
    flat = PolicyNetwork(network, learning_rate=0.01, max_gradient_norm=0.5)
    logits, value = flat.outputs(sparse_rows(batches(1)[0]))
    flat.descend(100 * value.mean() + 0.001 * logits[:, 0].mean())
    # After its first step Adam's mean is a tenth of the gradient.
    gradients = {name.removeprefix("exp_avg/"): 10 * array for name, array in flat.state().items() if "avg/" in name}
    critic = [gradient.ravel() for name, gradient in gradients.items() if name.startswith("critic")]
    assert np.linalg.norm(np.concatenate(critic)) == pytest.approx(0.5, rel=1e-4)
    expected = torch.autograd.grad(
        0.001 * network.logits(torch.tensor(batches(1)[0]))[:, 0].mean(), network.actor.bias
    )[0]
    np.testing.assert_allclose(gradients["actor.bias"], expected, rtol=1e-4)


def test_weights_are_a_copy_with_the_names_and_shapes_of_the_network():
    network = make_network()
    flat = PolicyNetwork(network, 0.01, 0.5)
    assert {name: array.shape for name, array in flat.weights().items()} == {
        name: array.shape for name, array in export_parameters(network).items()
    }
    flat.weights()["critic.bias"][:] = 9
    assert flat.weights()["critic.bias"] == 0


def test_values_are_those_of_outputs():
    flat = PolicyNetwork(make_network(), 0.01, 0.5)
    batch = batches(1)[0]
    np.testing.assert_array_equal(flat.values(sparse_rows(batch)), flat.outputs(sparse_rows(batch))[1].detach())


def test_a_state_that_does_not_fit_is_refused():
    flat = PolicyNetwork(make_network(), 0.01, 0.5)
    with pytest.raises(ValueError, match=r"network/critic\.bias is missing"):
        flat.restore({name: array for name, array in flat.state().items() if name != "network/critic.bias"})
