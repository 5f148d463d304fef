"""Updates of policies are those of plain torch, but for rounding."""

import numpy as np
import pytest
import torch
from made_episodes import some_allowed
from made_networks import first_of

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import export_parameters
from railctl.common.policy.packing import Layout
from railctl.common.rules.policies import PpoConfig
from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.sil import SilConfig
from railctl.services.learner.algorithms.ppo import Ppo
from railctl.services.learner.algorithms.sil import Sil
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused.policy import FusedPolicy
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.plain_policy import PlainPolicy
from railctl.services.learner.textbook.policies import PolicyNetwork

PPO = PpoConfig(learning_rate=0.003, epochs=1, entropy_weight=0.1, max_gradient_norm=0.1)
SIL = SilConfig(epochs=1, batch_size=40, value_weight=0.5)


def batches(count, size=40, features=6, actions=3):
    rng = np.random.default_rng(1)
    for _ in range(count):
        observation = -rng.random((size, features), np.float32) * (rng.random((size, features)) < 0.5)
        action = rng.integers(actions, size=size)
        yield Experience(
            observation_tm1=observation.astype(np.float32),
            action_tm1=action,
            allowed_tm1=some_allowed(rng, actions, size, action),
            return_t=-rng.random(size, np.float32),
            least_return_t=-rng.random(size, np.float32),
            log_probability_tm1=-0.6 - rng.random(size, np.float32),
            value_tm1=-rng.random(size, np.float32),
        )


def test_what_a_policy_says_of_old_decisions_is_what_plain_torch_says():
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=(8, 5)), 6, 3, seed=1)
    with torch.no_grad():
        network.actor.weight.mul_(100)
    ours, plain = FusedPolicy(first_of(network), 0.01, 0.5), PolicyNetwork(network, 0.01, 0.5)
    for batch in batches(3):
        x = sparse_rows(batch.observation_tm1)
        for one, other in zip(ours.reconsider(x, batch), plain.reconsider(x, batch), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-5)
    assert (ours.reconsider(x, batch)[0] < 0).any()


def test_what_a_policy_says_as_it_acts_is_what_it_says_when_it_learns_to_the_bit():
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=(8, 5)), 6, 3, seed=1)
    ours, twin = FusedPolicy(first_of(network), 0.01, 0.5), Twin(Layout("actor-critic", 6, 3, (8, 5)))
    twin.load(ours.weights())
    [batch] = batches(1)
    count = len(batch.action_tm1)
    keys, counters = np.full(count, 7, np.uint64), np.arange(count, dtype=np.uint64)
    allowed = batch.allowed_tm1.astype(np.uint8)
    choices = twin.act(batch.observation_tm1, np.zeros(count), keys, counters, allowed=allowed)
    chosen = batch._replace(action_tm1=choices.actions.astype(np.int64))
    log_probabilities, values = ours.reconsider(sparse_rows(batch.observation_tm1), chosen)
    assert log_probabilities.tobytes() == choices.log_probabilities.tobytes()
    assert values.tobytes() == choices.outputs[:, -1].tobytes()


@pytest.mark.parametrize("hidden", [(8,), (8, 5), (8, 5, 7)])
def test_updates_are_those_of_plain_torch(hidden):
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=hidden), 6, 3, seed=1)
    ours = FusedPolicy(first_of(network), PPO.learning_rate, PPO.max_gradient_norm)
    ppo, sil, plain = Ppo(PPO, ours), Sil(SIL, ours), PlainPolicy(network, PPO)
    for batch in batches(20):
        [told] = ppo.update(sparse_rows(batch.observation_tm1), batch)
        loss = told["policy_loss"] + 0.5 * told["value_loss"] - 0.1 * told["entropy"]
        assert plain.update(batch) == pytest.approx(loss, abs=1e-5)
        told, _ = sil.update(sparse_rows(batch.observation_tm1), batch)
        loss = told["sil_policy_loss"] + 0.5 * told["sil_value_loss"]
        assert plain.imitate(batch, SIL) == pytest.approx(loss, abs=1e-5)
    for name, array in export_parameters(network).items():
        np.testing.assert_allclose(ours.weights()[name], array, atol=1e-4, err_msg=name)
