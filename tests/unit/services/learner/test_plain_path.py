"""A module of one's own learns the same thing by autograd as the fast path does in compiled code."""

import numpy as np
import pytest
import torch
from made_episodes import some_allowed
from made_networks import first_of, fused_of
from torch import nn

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.networks import build_network
from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.rules.policies import PpoConfig
from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.sil import SilConfig
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.algorithms.ppo import Ppo
from railctl.services.learner.algorithms.sil import Sil
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused.drqn import FusedDrqn
from railctl.services.learner.fused.policy import FusedPolicy
from railctl.services.learner.sparse import dense_rows, sparse_rows
from railctl.services.learner.textbook.allowing import allowed_only
from railctl.services.learner.textbook.dqn import Dqn, TensorBatch
from railctl.services.learner.textbook.modules import ModuleValues
from railctl.services.learner.textbook.policies import PolicyNetwork
from railctl.services.learner.textbook.shapes import check_shapes
from railctl.services.learner.training import Batch

FEATURES, ACTIONS, SIZE = 6, 3, 40


class Own(nn.Module):
    """A module that the fast path does not know: another one in disguise."""

    def __init__(self, inner):
        super().__init__()
        self.inner = inner

    def forward(self, observation):
        return self.inner(observation)


class Shared(nn.Module):
    """Actor and critic on one trunk."""

    def __init__(self):
        super().__init__()
        self.trunk, self.critic, self.actor = nn.Linear(FEATURES, 8), nn.Linear(8, 1), nn.Linear(8, ACTIONS)

    def forward(self, observation):
        x = torch.tanh(self.trunk(observation))
        return self.actor(x), self.critic(x).squeeze(-1)


def mostly_zeros(rng, *shape):
    return -rng.random(shape, np.float32) * (rng.random(shape) < 0.5).astype(np.float32)


def value_batches(count, *lengths):
    rng = np.random.default_rng(1)
    for _ in range(count):
        yield Batch(
            observation_tm1=mostly_zeros(rng, *lengths, SIZE, FEATURES),
            action_tm1=rng.integers(ACTIONS, size=SIZE),
            reward_t=-rng.random(SIZE, np.float32),
            discount_t=rng.choice([0, 0.9], SIZE).astype(np.float32),
            allowed_t=some_allowed(rng, ACTIONS, SIZE),
            observation_t=mostly_zeros(rng, *lengths, SIZE, FEATURES),
            weights=rng.random(SIZE, np.float32),
        )


def policy_batches(count):
    rng = np.random.default_rng(2)
    for _ in range(count):
        action = rng.integers(ACTIONS, size=SIZE)
        yield Experience(
            observation_tm1=mostly_zeros(rng, SIZE, FEATURES),
            action_tm1=action,
            allowed_tm1=some_allowed(rng, ACTIONS, SIZE, action),
            return_t=-rng.random(SIZE, np.float32),
            least_return_t=-rng.random(SIZE, np.float32),
            log_probability_tm1=-0.6 - rng.random(SIZE, np.float32),
            value_tm1=-rng.random(SIZE, np.float32),
        )


def assert_same_weights(plain, fast):
    ours = plain.weights()
    assert {name.removeprefix("inner.") for name in ours} == set(fast.weights())
    for name, array in fast.weights().items():
        np.testing.assert_allclose(ours[f"inner.{name}"], array, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("kind", ["plain", "dueling", "dueling-apart"])
@pytest.mark.parametrize(
    "switches", [{}, *({"target_tau": 0.1, "double": double} for double in (False, True, "reversed"))]
)
def test_action_values_are_learned_as_on_the_fast_path(kind, switches):
    network = build_network(NetworkConfig(kind=kind, hidden=(32, 20)), FEATURES, ACTIONS, seed=1)
    config = DqnConfig(learning_rate=0.003, batch_size=SIZE, learn_every_steps=1, **switches)
    plain, fast = Dqn(config, Own(network)), fused_of(config, network)
    for batch in value_batches(20):
        ours, theirs = plain.update(batch), fast.update(batch)
        np.testing.assert_allclose(ours.error_sizes, theirs.error_sizes, atol=1e-5)
        assert ours.metrics == pytest.approx(theirs.metrics, abs=1e-4)
    assert_same_weights(plain, fast)


def test_sequences_are_learned_as_on_the_fast_path():
    network = build_recurrent_network(NetworkConfig(kind="recurrent", hidden=(16, 8)), FEATURES, ACTIONS, seed=1)
    config = DqnConfig(learning_rate=0.003, batch_size=SIZE, learn_every_steps=1, target_tau=0.1)
    plain, fast = Dqn(config, Own(network)), FusedDrqn(config, first_of(network))
    for batch in value_batches(10, 4):
        batch.observation_tm1[0] -= 1  # no sequence begins late
        batch.observation_t[0] -= 1
        plain.update(batch)
        fast.update(batch)
    assert_same_weights(plain, fast)


@pytest.mark.parametrize("limit", [0.1, 1e9])
def test_policies_are_learned_as_on_the_fast_path(limit):
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=(32, 20)), FEATURES, ACTIONS, seed=1)
    ppo = PpoConfig(learning_rate=0.003, epochs=1, entropy_weight=0.1)
    fast = FusedPolicy(first_of(network), ppo.learning_rate, limit)
    plain = PolicyNetwork(Own(network), ppo.learning_rate, limit, FEATURES)
    assert len(plain._body.parts) == 2
    sil = SilConfig(epochs=1, batch_size=SIZE)
    for batch in policy_batches(20):
        x = sparse_rows(batch.observation_tm1)
        [ours], [theirs] = Ppo(ppo, plain).update(x, batch), Ppo(ppo, fast).update(x, batch)
        assert ours == pytest.approx(theirs, abs=1e-4)
        ours, theirs = Sil(sil, plain).update(x, batch)[0], Sil(sil, fast).update(x, batch)[0]
        assert ours == pytest.approx(theirs, abs=1e-4)
    assert_same_weights(plain, fast)
    np.testing.assert_allclose(plain.values(x), fast.values(x), rtol=1.3e-6, atol=1e-5)


def test_actor_and_critic_on_one_trunk_are_clipped_together():
    torch.manual_seed(1)
    network = PolicyNetwork(Shared(), learning_rate=0.01, max_gradient_norm=0.5, n_features=FEATURES)
    [batch] = policy_batches(1)
    logits, value = network.outputs(sparse_rows(batch.observation_tm1))
    norm = network.descend(100 * value.mean() + 100 * logits[:, 0].mean())
    assert norm > 50
    # After its first step Adam's mean is a tenth of the gradient.
    gradients = [10 * array.ravel() for name, array in network.state().items() if "avg/" in name]
    assert np.linalg.norm(np.concatenate(gradients)) == pytest.approx(0.5, rel=1e-4)


def test_parameters_of_any_number_of_dimensions_are_trained():
    torch.manual_seed(1)
    module = nn.Sequential(nn.Unflatten(-1, (1, 2, 3)), nn.Conv2d(1, 20, 2), nn.Flatten(), nn.Linear(40, ACTIONS))
    reference = torch.optim.Adam(module.parameters(), lr=0.01)
    config = DqnConfig(learning_rate=0.01, batch_size=SIZE, learn_every_steps=1)
    dqn = Dqn(config, module)
    for batch in value_batches(5):
        dqn.update(batch)
        own = TensorBatch.of(batch)
        with torch.no_grad():
            q_t = allowed_only(module(torch.tensor(batch.observation_t)), own.allowed_t)
            target = own.reward_t + own.discount_t * q_t.amax(-1)
        taken = module(torch.tensor(batch.observation_tm1)).gather(-1, own.action_tm1[:, None])[:, 0]
        reference.zero_grad()
        (own.weights * (taken - target) ** 2).mean().backward()
        reference.step()
    for name, parameter in module.named_parameters():
        np.testing.assert_allclose(dqn.weights()[name], parameter.detach().numpy(), atol=1e-5, err_msg=name)


def test_a_restored_module_goes_on_with_the_same_bits():
    torch.manual_seed(1)
    config = DqnConfig(learning_rate=0.01, batch_size=SIZE, learn_every_steps=1, target_tau=0.1)
    module = nn.Sequential(nn.Linear(FEATURES, 8), nn.ReLU(), nn.Linear(8, ACTIONS))
    before = {name: value.clone() for name, value in module.state_dict().items()}
    straight, restored = Dqn(config, module), Dqn(config, module)
    *first, last = value_batches(6)
    for batch in first:
        straight.update(batch)
    restored.restore(straight.state())
    for dqn in (straight, restored):
        dqn.update(last)
    assert all(array.tobytes() == restored.state()[name].tobytes() for name, array in straight.state().items())
    assert all(torch.equal(value, before[name]) for name, value in module.state_dict().items())  # it learns a copy


def test_a_module_that_keeps_more_than_parameters_is_refused():
    with pytest.raises(ValueError, match="module BatchNorm1d has buffer running_mean: only parameters are kept"):
        ModuleValues(nn.BatchNorm1d(FEATURES))


def test_dense_rows_undo_sparse_ones():
    x = mostly_zeros(np.random.default_rng(1), 3, 4, FEATURES)
    np.testing.assert_array_equal(dense_rows(sparse_rows(x)), x)
    assert dense_rows(sparse_rows(np.zeros((0, FEATURES), np.float32))).shape == (0, FEATURES)


@pytest.mark.parametrize(
    ("letters", "shapes"),
    [("B BA", [(2,), (2, 1)]), ("B BA BA", [(2,), (2, 3), (2, 3)]), ("P P", [(7,), (7,)])],
)
def test_shapes_that_fit_pass(letters, shapes):
    check_shapes(letters, *map(torch.zeros, shapes))


@pytest.mark.parametrize("shapes", [[(2,), (3, 5)], [(2, 1), (2, 5)], [(2,), (2,)], [(), (2, 5)]])
def test_shapes_that_do_not_fit_are_named(shapes):
    with pytest.raises(ValueError, match=r"shapes are \[.*, not those of B BA"):
        check_shapes("B BA", *map(torch.zeros, shapes))
