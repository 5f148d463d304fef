"""Losses of self-imitation, which priorities follow from them, and what is left alone."""

import math

import numpy as np
import pytest
import torch
from test_ppo import SETTINGS, batch_of, make_network

from railctl.common.rules.policies import PpoConfig
from railctl.common.rules.replay import PrioritizedReplay
from railctl.common.rules.sil import SilConfig
from railctl.services.learner.algorithms.ppo import WholeEpisodes
from railctl.services.learner.algorithms.sil import SelfImitation, Sil
from railctl.services.learner.experience import ExperienceReplay
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.sil import imitation_policy_loss, imitation_value_loss


def test_imitation_policy_loss_by_hand():
    logs = torch.tensor([math.log(0.5), math.log(0.1)], requires_grad=True)
    loss = imitation_policy_loss(logs, torch.tensor([0.3, 0.0]))
    torch.testing.assert_close(loss, torch.tensor([0.3 * math.log(2), 0.0]))
    assert torch.autograd.grad(loss.sum(), logs)[0].tolist() == pytest.approx([-0.3, 0])


def test_imitation_value_loss_by_hand():
    value = torch.tensor([-0.8, -0.2], requires_grad=True)
    loss = imitation_value_loss(value, torch.tensor([-0.5, -0.5]))
    torch.testing.assert_close(loss, torch.tensor([0.045, 0.0]))
    assert torch.autograd.grad(loss.sum(), value)[0].tolist() == pytest.approx([-0.3, 0])


class Drawn(ExperienceReplay):
    """Remembers what priorities it was given."""

    def __init__(self, capacity):
        super().__init__(PrioritizedReplay(capacity=capacity, beta=0), 1, seed=1)
        self.given = []

    def add(self, new, priorities=None):
        self.given.append(priorities.tolist())
        super().add(new, priorities)

    def reprioritise(self, places, priorities):
        self.given.append(dict(zip(places.tolist(), priorities.tolist(), strict=True)))
        super().reprioritise(places, priorities)


def make_rule(*, epochs=1, batch_size=2, value_weight=0.01, returns="least"):
    config = PpoConfig(**(SETTINGS | {"epochs": 1, "learning_rate": 1e-30}))  # ppo's epochs leave the network alone
    network, replay = make_network(config), Drawn(10)
    sil = SilConfig(epochs=epochs, batch_size=batch_size, value_weight=value_weight, returns=returns)
    return SelfImitation(sil, 10, WholeEpisodes(config, network), Sil(sil, network), replay), network, replay


def test_only_what_turned_out_well_is_drawn_and_imitated():
    rule, _, replay = make_rule(batch_size=2, value_weight=1.0)
    ppo, sil = rule.learn(batch_of([0, 1], [-0.9, -0.1], values=[-0.5, -0.6]))
    assert replay.given[0] == pytest.approx([0, 0.5])  # by the values when acting
    assert list(replay.given[1]) == [1]  # the bad one has no priority, and is not drawn in two draws
    assert replay.given[1][1] == pytest.approx(0.4)  # by the value of now, -0.5
    assert "policy_loss" in ppo
    assert sil == pytest.approx(
        {
            "sil_policy_loss": 0.4 * math.log(2),
            "sil_value_loss": 0.08,
            "sil_gain": 0.4,
            "sil_positive_share": 1.0,
            "sil_gradient_norm": math.sqrt(2 * 0.2**2 + 0.4**2),
        },
        rel=1e-5,
    )


def test_an_update_by_hand():
    network = make_network(PpoConfig(**SETTINGS))
    batch = batch_of([1, 0], [-0.1, -0.9])  # gains 0.4 and 0; the value is -0.5
    metrics, gain = Sil(SilConfig(epochs=1, batch_size=2, value_weight=0.5), network).update(
        sparse_rows(batch.observation_tm1), batch
    )
    assert gain.tolist() == pytest.approx([0.4, 0])
    # dL/dlogits is -0.4 * (-0.5, 0.5) / 2 = (0.1, -0.1); dL/dvalue is 0.5 * -0.4 / 2 = -0.1.
    assert metrics == pytest.approx(
        {
            "sil_policy_loss": 0.2 * math.log(2),
            "sil_value_loss": 0.04,
            "sil_gain": 0.2,
            "sil_positive_share": 0.5,
            "sil_gradient_norm": math.sqrt(3 * 0.1**2),
        },
        rel=1e-5,
    )
    np.testing.assert_allclose(network.weights()["actor.bias"], [-0.1, 0.1], rtol=1e-5)
    np.testing.assert_allclose(network.weights()["critic.bias"], [-0.4], rtol=1e-5)


def test_a_forced_decision_teaches_the_critic_alone():
    network = make_network(PpoConfig(**SETTINGS))
    batch = batch_of([1, 0], [-0.1, -0.9], allowed=[0b10, 0b11])  # gains 0.4 and 0
    metrics, _ = Sil(SilConfig(epochs=1, batch_size=2, value_weight=0.5), network).update(
        sparse_rows(batch.observation_tm1), batch
    )
    assert metrics["sil_policy_loss"] == 0
    assert metrics["sil_gradient_norm"] == pytest.approx(0.1)
    assert network.weights()["actor.bias"].tolist() == [0, 0]


def test_no_imitation_before_the_replay_holds_a_batch():
    rule, _, _ = make_rule(epochs=3, batch_size=3)
    assert len(rule.learn(batch_of([0, 1], [-0.9, -0.1]))) == 1
    assert len(rule.learn(batch_of([0, 1], [-0.9, -0.1]))) == 4


def test_what_a_stopped_train_might_still_have_got_is_not_imitated():
    rule, _, replay = make_rule(value_weight=1.0)
    hopeful = batch_of([0, 1], [-0.1, -0.1])._replace(least_return_t=np.array([-0.9, -0.4], np.float32))
    _, sil = rule.learn(hopeful)
    assert replay.given[0] == pytest.approx([0, 0.1])
    assert sil["sil_gain"] == pytest.approx(0.1)
    assert sil["sil_value_loss"] == pytest.approx(0.005)


def test_one_return_for_both_parts_is_the_critic_s_guess():
    rule, _, replay = make_rule(value_weight=1.0, returns="bootstrapped")
    hopeful = batch_of([0, 1], [-0.3, -0.3])._replace(least_return_t=np.array([-0.9, -0.9], np.float32))
    _, sil = rule.learn(hopeful)
    assert replay.given[0] == pytest.approx([0.2, 0.2])
    assert sil["sil_gain"] == pytest.approx(0.2)
