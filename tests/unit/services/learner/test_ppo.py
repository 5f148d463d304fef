"""Losses of proximal policy optimisation and one whole update, worked by hand."""

import math

import numpy as np
import pytest
import torch
from made_networks import first_of

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.networks import import_parameters
from railctl.common.rules.policies import PpoConfig
from railctl.common.rules.ppo import Settings
from railctl.common.rules.settings import NetworkConfig
from railctl.services.learner.algorithms.ppo import Ppo
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused.policy import FusedPolicy
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.policies import PolicyNetwork
from railctl.services.learner.textbook.ppo import (
    clipped_surrogate,
    clipped_value_loss,
    divergence,
    entropy,
    log_probability,
    standardised,
)


def test_log_probability_by_hand():
    logits = torch.tensor([[0.0, math.log(3)], [5.0, 5.0]])
    got = log_probability(logits, torch.tensor([1, 0]))
    torch.testing.assert_close(got, torch.tensor([math.log(0.75), math.log(0.5)]))


def test_standardised_by_hand():
    got = standardised(torch.tensor([0.4, -0.2]))  # mean 0.1, deviation 0.3
    torch.testing.assert_close(got, torch.tensor([0.3 / 0.301, -0.3 / 0.301]))
    assert standardised(torch.tensor([5.0])).tolist() == [0]
    assert standardised(torch.tensor([5.0, 5.0])).tolist() == [0, 0]


@pytest.mark.parametrize(
    ("ratio", "advantage", "objective", "slope"),
    [
        (1.0, 2.0, 2.0, 2.0),
        (1.5, 2.0, 2.4, 0.0),  # more likely by more than a fifth: nothing more to gain
        (0.5, 2.0, 1.0, 2.0),  # less likely although it was good: the way back stays open
        (0.5, -2.0, -1.6, 0.0),  # less likely by more than a fifth: nothing more to gain
        (1.5, -2.0, -3.0, -2.0),  # more likely although it was bad
        (1.1, 0.0, 0.0, 0.0),
    ],
)
def test_clipped_surrogate_by_hand(ratio, advantage, objective, slope):
    ratios = torch.tensor([ratio], requires_grad=True)
    got = clipped_surrogate(ratios, torch.tensor([advantage]), 0.2)
    assert got.item() == pytest.approx(objective)
    assert torch.autograd.grad(got.sum(), ratios)[0].item() == pytest.approx(slope)


@pytest.mark.parametrize(
    ("value", "old", "return_t", "loss", "slope"),
    [
        (-0.5, -0.5, -0.7, 0.04, 0.4),
        (-0.8, -0.5, -0.9, 0.04, 0.0),  # held at -0.7, 0.2 from the return: the larger error, and a constant
        (-0.1, -0.5, -0.9, 0.64, 1.6),  # moved the wrong way: held at -0.3, but the value's own error is larger
    ],
)
def test_clipped_value_loss_by_hand(value, old, return_t, loss, slope):
    values = torch.tensor([value], requires_grad=True)
    got = clipped_value_loss(values, torch.tensor([old]), torch.tensor([return_t]), 0.2)
    assert got.item() == pytest.approx(loss, rel=1e-5)
    assert torch.autograd.grad(got.sum(), values)[0].item() == pytest.approx(slope, rel=1e-5)


def test_entropy_by_hand():
    logits = torch.tensor([[1.0, 1.0, 1.0, 1.0], [0.0, math.log(3), -1000.0, -1000.0], [900.0, 0.0, 0.0, 0.0]])
    expected = [math.log(4), math.log(4) - 0.75 * math.log(3), 0.0]
    torch.testing.assert_close(entropy(logits), torch.tensor(expected))


SETTINGS = {"learning_rate": 0.1, "epochs": 1, "clip": 0.2, "value_weight": 0.5, "entropy_weight": 0.0}


def make_network(config):
    """Logits (0, 0) and a value of -0.5 whatever is seen: all hidden units are 0."""
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=(1,)), n_features=1, n_actions=2, seed=0)
    zeros = {name: np.zeros(tuple(tensor.shape), np.float32) for name, tensor in network.named_parameters()}
    import_parameters(network, zeros | {"critic.bias": np.array([-0.5], np.float32)})
    return FusedPolicy(first_of(network), config.learning_rate, config.max_gradient_norm)


def batch_of(actions, returns, values=None, log_probabilities=None, allowed=None):
    count = len(actions)
    return Experience(
        observation_tm1=np.zeros((count, 1), np.float32),
        action_tm1=np.array(actions),
        allowed_tm1=np.array(allowed or [0b11] * count),
        return_t=np.array(returns, np.float32),
        least_return_t=np.array(returns, np.float32),
        log_probability_tm1=np.array(log_probabilities or [math.log(0.5)] * count, np.float32),
        value_tm1=np.array(values or [-0.5] * count, np.float32),
    )


def update(config, network, batch):
    [metrics] = Ppo(config, network).update(sparse_rows(batch.observation_tm1), batch)
    return metrics


def test_an_update_by_hand():
    config = PpoConfig(**SETTINGS)
    network = make_network(config)
    # Advantages 0.4 and -0.2, standardised 1 and -1, but for the floor. Ratios are 1: dL/dlogits is
    # -(1 * (0.5, -0.5) - 1 * (-0.5, 0.5)) / 2 = (-0.5, 0.5); dL/dvalue is 0.5 * 2 * -(0.4 - 0.2) / 2 = -0.1.
    # Adam's first step is the sign times the rate.
    metrics = update(config, network, batch_of([0, 1], [-0.1, -0.7]))
    assert metrics == pytest.approx(
        {
            "policy_loss": 0.0,  # -(1 - 1) / 2
            "value_loss": 0.1,  # (0.16 + 0.04) / 2
            "entropy": math.log(2),
            "value_error": 0.3,
            "clip_share": 0.0,
            "kl": 0.0,
            "gradient_norm": math.sqrt(2 * (0.5 * 0.3 / 0.301) ** 2 + 0.1**2),
        },
        rel=1e-5,
        abs=1e-7,
    )
    weights = network.weights()
    np.testing.assert_allclose(weights["actor.bias"], [0.1, -0.1], rtol=1e-5)
    np.testing.assert_allclose(weights["critic.bias"], [-0.4], rtol=1e-5)


def test_plain_advantages_by_hand():
    config = PpoConfig(**SETTINGS, advantages="plain")
    # 0.4 and -0.2 as they are: dL/dlogits is -(0.4 * (0.5, -0.5) - 0.2 * (-0.5, 0.5)) / 2 = (-0.15, 0.15).
    metrics = update(config, make_network(config), batch_of([0, 1], [-0.1, -0.7]))
    assert metrics["policy_loss"] == pytest.approx(-0.1)
    assert metrics["gradient_norm"] == pytest.approx(math.sqrt(2 * 0.15**2 + 0.1**2), rel=1e-5)


def test_a_forced_decision_says_nothing_of_the_policy():
    config = PpoConfig(**SETTINGS)
    network = make_network(config)
    batch = batch_of([0, 1], [-0.1, -0.7], log_probabilities=[math.log(0.5), 0.0], allowed=[0b11, 0b10])
    # As by hand above, but that the second action has the probability 1, and dL/dlogits is zero there.
    metrics = update(config, network, batch)
    assert metrics["entropy"] == pytest.approx(math.log(2) / 2)
    assert (metrics["policy_loss"], metrics["kl"]) == pytest.approx((0, 0), abs=1e-7)
    assert metrics["gradient_norm"] == pytest.approx(math.sqrt(2 * (0.25 * 0.3 / 0.301) ** 2 + 0.1**2), rel=1e-5)


def test_a_policy_that_has_moved_is_told():
    config = PpoConfig(**SETTINGS)
    old = [math.log(0.25), math.log(0.5)]  # ratios 2 and 1
    metrics = update(config, make_network(config), batch_of([0, 1], [-0.4, -0.5], log_probabilities=old))
    assert metrics["clip_share"] == 0.5
    assert metrics["kl"] == pytest.approx((1 - math.log(2)) / 2)
    assert metrics["policy_loss"] == pytest.approx(-(1.2 - 1) / 2 * 0.05 / 0.051, rel=1e-4)


def test_the_entropy_bonus_keeps_the_policy_undecided():
    config = PpoConfig(**(SETTINGS | {"entropy_weight": 1.0, "value_weight": 0.0}))
    network = make_network(config)
    network.restore(network.state() | {"network/actor.bias": np.array([1, 0], np.float32)})
    sure = [math.log(1 / (1 + math.exp(-1)))]
    update(config, network, batch_of([0], [-0.5], log_probabilities=sure))  # no advantage
    np.testing.assert_allclose(network.weights()["actor.bias"], [0.9, 0.1], rtol=1e-4)


def test_divergence_by_hand():
    logits = torch.tensor([[0.0, math.log(3), -1e9], [1.0, 1.0, 1.0]], requires_grad=True)
    start = torch.tensor([[0.0, 0.0, -1e9], [1.0, 1.0, 1.0]])
    got = divergence(logits, start)
    apart = 0.25 * math.log(0.5) + 0.75 * math.log(1.5)
    torch.testing.assert_close(got, torch.tensor([apart, 0.0]))
    [slopes] = torch.autograd.grad(got.sum(), logits)  # p (log p/q - KL): 0.25 (log 1/2 - KL) and its opposite
    slope = 0.25 * (math.log(0.5) - apart)
    torch.testing.assert_close(slopes, torch.tensor([[slope, -slope, 0.0], [0.0, 0.0, 0.0]]), atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize(("actions", "allowed", "share"), [([0], [0b11], 1.0), ([0, 1], [0b11, 0b10], 0.5)])
def test_an_anchor_by_hand(actions, allowed, share):
    """The policy has moved to 1/4 and 3/4 from 1/2 each; a forced decision has no part in it but in the mean."""
    config = PpoConfig(**(SETTINGS | {"value_weight": 0.0, "anchor_weight": 2.0}))
    network = make_network(config)
    network.restore(network.state() | {"network/actor.bias": np.array([0, math.log(3)], np.float32)})
    log_probabilities = [math.log(0.25), 0.0][: len(actions)]
    batch = batch_of(actions, [-0.5] * len(actions), log_probabilities=log_probabilities, allowed=allowed)
    metrics = update(config, network, batch)  # without advantages
    apart = 0.25 * math.log(0.5) + 0.75 * math.log(1.5)
    slope = 2 * share * 0.25 * (math.log(0.5) - apart)
    assert metrics["gradient_norm"] == pytest.approx(math.sqrt(2) * abs(slope), rel=1e-5)
    np.testing.assert_allclose(network.weights()["actor.bias"], [0.1, math.log(3) - 0.1], rtol=1e-4)
    [*_, loss] = network.ppo(config, sparse_rows(batch.observation_tm1), batch, 1)[0]
    assert loss < 2 * share * apart


def test_an_anchor_holds_nobody_where_he_began():
    config = PpoConfig(**SETTINGS)
    free, held = make_network(config), make_network(config)
    batch = batch_of([0, 1], [-0.1, -0.7])
    update(config, free, batch)
    update(config.model_copy(update={"anchor_weight": 5.0}), held, batch)
    assert all(array.tobytes() == held.state()[name].tobytes() for name, array in free.state().items())


def test_autograd_is_anchored_alike():
    config = PpoConfig(**(SETTINGS | {"anchor_weight": 0.7, "learning_rate": 1e-3}))
    first = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=(4,)), n_features=1, n_actions=2, seed=3)
    ours = FusedPolicy(first_of(first), config.learning_rate, config.max_gradient_norm)
    theirs = PolicyNetwork(first, config.learning_rate, config.max_gradient_norm)
    moved = {"network/actor.bias": np.array([0.0, 2.0], np.float32)}
    ours.restore(ours.state() | moved)
    theirs.restore(theirs.state() | moved)
    batch = batch_of([0, 1, 1], [-0.1, -0.7, -0.4], allowed=[0b11, 0b10, 0b11])
    x = sparse_rows(batch.observation_tm1)
    np.testing.assert_allclose(ours.ppo(config, x, batch, 2), theirs.ppo(config, x, batch, 2), rtol=1e-4, atol=1e-6)
    for name, array in theirs.weights().items():
        np.testing.assert_allclose(ours.weights()[name], array, rtol=1e-4, atol=1e-6)


def test_an_anchor_needs_a_policy_to_begin_with():
    plain = {"ppo": SETTINGS | {"anchor_weight": 0.1}}
    with pytest.raises(ValueError, match="it holds to the policy of start_from, give that as well"):
        Settings.model_validate(plain)
    assert Settings.model_validate(plain | {"start_from": {"checkpoint": "some"}}).ppo.anchor_weight == 0.1


def test_epochs_together_are_epochs_one_by_one():
    config = PpoConfig(**SETTINGS)
    together, apart = make_network(config), make_network(config)
    batch = batch_of([0, 1], [-0.1, -0.7])
    rows = Ppo(config, together).update(sparse_rows(batch.observation_tm1), batch, 3)
    assert rows == [update(config, apart, batch) for _ in range(3)]
    assert all(array.tobytes() == apart.state()[name].tobytes() for name, array in together.state().items())
    assert together.steps == 3


def test_diverging_is_an_error_and_changes_nothing():
    config = PpoConfig(**SETTINGS)
    network = make_network(config)
    before = network.state()
    with pytest.raises(FloatingPointError, match=r"lower ppo\.learning_rate"):
        update(config, network, batch_of([0], [math.nan]))
    assert all(array.tobytes() == before[name].tobytes() for name, array in network.state().items())
