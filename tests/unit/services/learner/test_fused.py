"""Compiled updates against plain loops, torch's autograd in float64, the networks that act, and themselves."""

import copy

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from made_episodes import some_allowed
from made_networks import first_of, fused_of

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.arithmetic import tanh32
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.packing import Layout
from railctl.common.rules.policies import PpoConfig
from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.sil import SilConfig
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.algorithms.ppo import Ppo
from railctl.services.learner.algorithms.sil import Sil
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused import perceptron, products
from railctl.services.learner.fused.adam import LEAST, move
from railctl.services.learner.fused.packed import VALUES
from railctl.services.learner.fused.policy import FusedPolicy
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.dqn import Dqn
from railctl.services.learner.textbook.plain_dqn import PlainDqn
from railctl.services.learner.textbook.plain_policy import PlainPolicy
from railctl.services.learner.textbook.policies import PolicyNetwork
from railctl.services.learner.training import Batch

KINDS = ["plain", "dueling", "dueling-apart"]
SHAPES = st.tuples(st.sampled_from([(8,), (16, 33), (5, 17, 9)]), st.integers(1, 20), st.integers(2, 19))
ROOM = 6  # rows that a product may write


def numbers(rng, *shape):
    return rng.standard_normal(shape).astype(np.float32)


def added_up(x, w, start):
    """X w + start, in float32, one product after the other."""
    total = np.broadcast_to(start, (len(x), w.shape[1])).astype(np.float32)
    for k in range(len(w)):
        total = total + x[:, k : k + 1] * w[k]
    return total


def in_room(matrix):
    """A flat copy, of at least as many rows as products need."""
    filled = np.zeros((max(ROOM, len(matrix)), matrix.shape[1]), np.float32)
    filled[: len(matrix)] = matrix
    return filled.reshape(-1)


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 30), st.integers(1, 3), st.integers(1, 3), st.integers(0, 2**31))
def test_products_are_those_of_the_plain_loop_to_the_bit(rows, k, n, seed):
    rng, n_in, n_out = np.random.default_rng(seed), 16 * k, 16 * n
    x, w, by_out, bias = (numbers(rng, *shape) for shape in ((rows, n_in), (n_in, n_out), (rows, n_out), (n_out,)))
    panel, nothing = np.empty(16 * 64, np.float32), np.zeros(48, np.float32)
    out, by_x, by_w = (np.zeros((max(ROOM, r), c), np.float32) for r, c in ((rows, n_out), (rows, n_in), w.shape))
    products.forward(in_room(x), rows, n_in, w.reshape(-1), bias, n_out, out.reshape(-1), panel)
    assert out[:rows].tobytes() == added_up(x, w, bias).tobytes()
    products.input_gradient(in_room(by_out), rows, n_out, w.reshape(-1), n_in, by_x.reshape(-1), panel, nothing)
    assert by_x[:rows].tobytes() == added_up(by_out, np.ascontiguousarray(w.T), 0).tobytes()
    products.weight_gradient(in_room(x), rows, n_in, in_room(by_out), n_out, nothing, 0, by_w.reshape(-1), panel)
    assert by_w.tobytes() == added_up(np.ascontiguousarray(x.T), by_out, 0).tobytes()


def test_tanh_is_exact_to_rounding_near_zero_too():
    sizes = np.concatenate([np.geomspace(1e-30, 20, 2000), [0, 1e30, np.inf]]).astype(np.float32)
    got = np.array([tanh32(x) for x in sizes])
    np.testing.assert_allclose(got, np.tanh(sizes.astype(np.float64)), rtol=4e-7)
    assert [tanh32(-x) for x in sizes] == (-got).tolist()
    assert np.isnan(tanh32(np.float32(np.nan)))


def observations(rng, rows, n_features):
    return numbers(rng, rows, n_features) * (rng.random((rows, n_features)) < 0.4).astype(np.float32)


def experience(rng, rows, n_features, n_actions):
    action = rng.integers(n_actions, size=rows)
    return Experience(
        observation_tm1=observations(rng, rows, n_features),
        action_tm1=action,
        allowed_tm1=some_allowed(rng, n_actions, rows, action),
        return_t=-rng.random(rows, np.float32),
        least_return_t=-rng.random(rows, np.float32),
        log_probability_tm1=np.float32(-np.log(n_actions) - 0.2) + np.float32(0.4) * rng.random(rows, np.float32),
        value_tm1=-rng.random(rows, np.float32),
    )


def transitions(rng, rows, n_features, n_actions):
    return Batch(
        observation_tm1=observations(rng, rows, n_features),
        action_tm1=rng.integers(n_actions, size=rows),
        reward_t=-rng.random(rows, np.float32),
        discount_t=rng.choice([0, 0.9], rows).astype(np.float32),
        allowed_t=some_allowed(rng, n_actions, rows),
        observation_t=observations(rng, rows, n_features),
        weights=rng.random(rows, np.float32),
    )


def in_float64(batch):
    return type(batch)(*(column.astype(np.float64) if column.dtype.kind == "f" else column for column in batch))


def actor_critic(hidden, n_features, n_actions):
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=hidden), n_features, n_actions, seed=1)
    with torch.no_grad():  # heads as large as anything else, so that every gradient is
        network.actor.weight.mul_(100)
    return network


def largest_gradient(network):
    """Of those that torch has left in a network."""
    return max(parameter.grad.abs().max().item() for parameter in network.parameters())


def assert_gradients_of_first_step(state, network, scale=0.0):
    """Adam's mean is then a tenth of the gradient; `scale` is what rounding is relative to, if that is larger."""
    scale = max(scale, largest_gradient(network))
    for name, parameter in network.named_parameters():
        got, expected = 10 * state[f"exp_avg/{name}"], parameter.grad.numpy()
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-4 * scale, err_msg=name)


def assert_same_weights(weights, network):
    """But for one in a hundred: where a gradient is as good as zero, Adam makes a step of its rounding."""
    expected = export_parameters(network)
    differences = np.concatenate([np.abs(weights[name] - array).reshape(-1) for name, array in expected.items()])
    scale = max(np.abs(array).max() for array in expected.values())
    assert np.quantile(differences, 0.99) < 1e-6 * scale
    assert differences.max() < 1e-3 * scale


@settings(deadline=None, max_examples=25)
@given(
    SHAPES,
    st.integers(4, 40),
    st.sampled_from([0.05, 1e9]),
    st.sampled_from(["standardised", "plain"]),
    st.integers(0, 2**31),
)
def test_ppo_has_the_gradients_of_autograd(shape, rows, limit, advantages, seed):
    config = PpoConfig(learning_rate=1e-3, epochs=1, advantages=advantages, entropy_weight=0.1, max_gradient_norm=limit)
    network, batch = actor_critic(*shape), experience(np.random.default_rng(seed), rows, *shape[1:])
    ours, plain = FusedPolicy(first_of(network), 1e-3, limit), PlainPolicy(copy.deepcopy(network).double(), config)
    Ppo(config, ours).update(sparse_rows(batch.observation_tm1), batch)
    plain.update(in_float64(batch))
    assert_gradients_of_first_step(ours.state(), plain._network)


def imitation_without_cancelling(network, batch, sil):
    """The largest gradient if the gains, R - V, were |R| + |V|: a gain is rounded as these are, however small it is."""
    twice = copy.deepcopy(network).double()
    with torch.no_grad():
        value = twice(torch.from_numpy(batch.observation_tm1))[1].numpy()
    return_t = batch.least_return_t
    return_t = np.where(return_t > value, value + np.abs(return_t) + np.abs(value), return_t)
    config = PpoConfig(learning_rate=1e-3, epochs=1, max_gradient_norm=1e9)
    PlainPolicy(twice, config).imitate(batch._replace(least_return_t=return_t), sil)
    return largest_gradient(twice)


@settings(deadline=None, max_examples=25)
@given(SHAPES, st.integers(1, 40), st.integers(0, 2**31))
def test_imitation_has_the_gradients_of_autograd(shape, rows, seed):
    config, sil = PpoConfig(learning_rate=1e-3, epochs=1), SilConfig(epochs=1, batch_size=rows, value_weight=0.5)
    network, batch = actor_critic(*shape), experience(np.random.default_rng(seed), rows, *shape[1:])
    ours, plain = FusedPolicy(first_of(network), 1e-3, 0.5), PlainPolicy(copy.deepcopy(network).double(), config)
    Sil(sil, ours).update(sparse_rows(batch.observation_tm1), batch)
    plain.imitate(in_float64(batch), sil)
    scale = imitation_without_cancelling(network, in_float64(batch), sil)
    assert_gradients_of_first_step(ours.state(), plain._network, scale)


def gradient_of_large_errors(config, network, batch):
    """The largest gradient with rewards less by one: an error is rounded as its terms are, however small it is."""
    twice = PlainDqn(config, copy.deepcopy(network).double())
    twice.update(batch._replace(reward_t=batch.reward_t - 1))
    return largest_gradient(twice._network)


@settings(deadline=None, max_examples=25)
@given(SHAPES, st.sampled_from(KINDS), st.integers(1, 40), st.integers(0, 2**31))
@example(((16, 33), 9, 9), "plain", 1, 9)  # an error of a thousandth of its terms
def test_action_values_have_the_gradients_of_autograd(shape, kind, rows, seed):
    hidden, n_features, n_actions = shape
    config = DqnConfig(learning_rate=1e-3, batch_size=rows, learn_every_steps=1, target_tau=0.1)
    network = build_network(NetworkConfig(kind=kind, hidden=hidden), n_features, n_actions, seed=1)
    batch = transitions(np.random.default_rng(seed), rows, n_features, n_actions)
    ours, plain = fused_of(config, network), PlainDqn(config, copy.deepcopy(network).double())
    ours.update(batch)
    plain.update(in_float64(batch))
    scale = gradient_of_large_errors(config, network, in_float64(batch))
    assert_gradients_of_first_step(ours.state(), plain._network, scale)


def test_ten_epochs_end_where_torch_does():
    config, shape = PpoConfig(learning_rate=5e-4, epochs=10), ((128, 128), 252, 5)
    network, batch = actor_critic(*shape), experience(np.random.default_rng(1), 85, 252, 5)
    ours, plain = FusedPolicy(first_of(network), 5e-4, 0.5), PlainPolicy(copy.deepcopy(network).double(), config)
    Ppo(config, ours).update(sparse_rows(batch.observation_tm1), batch, 10)
    for _ in range(10):
        plain.update(in_float64(batch))
    assert_same_weights(ours.weights(), plain._network)


@pytest.mark.parametrize("kind", KINDS)
def test_ten_updates_of_action_values_end_where_torch_does(kind):
    config = DqnConfig(learning_rate=3e-4, batch_size=150, learn_every_steps=1, target_tau=0.05)
    network, rng = build_network(NetworkConfig(kind=kind, hidden=(128, 128)), 252, 5, seed=1), np.random.default_rng(1)
    ours, plain = fused_of(config, network), PlainDqn(config, copy.deepcopy(network).double())
    for _ in range(10):
        batch = transitions(rng, 150, 252, 5)
        ours.update(batch)
        plain.update(in_float64(batch))
    assert_same_weights(ours.weights(), plain._network)


@pytest.mark.parametrize("hidden", [(8,), (16, 33), (5, 17, 9)])
def test_actors_and_learners_compute_the_same_bits(hidden):
    network, x = actor_critic(hidden, 20, 5), observations(np.random.default_rng(1), 9, 20)
    ours, twin = FusedPolicy(first_of(network), 1e-3, 0.5), Twin(Layout("actor-critic", 20, 5, hidden))
    twin.load(ours.weights())
    acted, rows = twin.outputs(x), sparse_rows(x)
    assert ours.values(rows).tobytes() == acted[:, 5].tobytes()
    widths, room = ours._widths[0], perceptron.room_for(ours._widths[0], 9)
    perceptron.outputs(widths, ours.arrays[VALUES], rows[1:], 9, True, room)
    logits = room.outs[perceptron.head(widths, 9) :].reshape(9, -1)[:, :5]
    assert logits.tobytes() == acted[:, :5].tobytes()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("hidden", [(8,), (16, 33), (5, 17, 9)])
def test_action_values_of_actors_and_learners_are_the_same_to_the_bit(hidden, kind):
    """Seen in the errors: of targets that are zero, for every action."""
    network, x = (
        build_network(NetworkConfig(kind=kind, hidden=hidden), 20, 5, 1),
        observations(np.random.default_rng(1), 9, 20),
    )
    config, twin = DqnConfig(learning_rate=1e-3, batch_size=9, learn_every_steps=1), Twin(Layout(kind, 20, 5, hidden))
    twin.load(fused_of(config, network).weights())
    acted = twin.outputs(x)
    for action in range(5):
        batch = transitions(np.random.default_rng(1), 9, 20, 5)._replace(
            observation_tm1=x,
            action_tm1=np.full(9, action),
            reward_t=np.zeros(9, np.float32),
            discount_t=np.zeros(9, np.float32),
        )
        assert fused_of(config, network).update(batch).error_sizes.tobytes() == np.abs(acted[:, action]).tobytes()


def states_of(learners):
    return [[array.tobytes() for array in learner.state().values()] for learner in learners]


@pytest.mark.parametrize("kind", ["dueling", "dueling-apart"])
@pytest.mark.parametrize("switches", [{}, {"target_tau": 0.1}, {"target_tau": 0.1, "double": True}])
def test_inputs_that_were_never_seen_are_left_out_without_a_difference(switches, kind):
    config = DqnConfig(learning_rate=3e-4, batch_size=20, learn_every_steps=1, **switches)
    network, rng = build_network(NetworkConfig(kind=kind, hidden=(16, 8)), 30, 5, seed=1), np.random.default_rng(1)
    left_out, all_in = fused_of(config, network), fused_of(config, network)
    all_in.seen[:] = True
    for _ in range(5):
        batch = transitions(rng, 20, 30, 5)
        batch.observation_tm1[:, ::2] = 0
        left_out.update(batch)
        all_in.update(batch)
    assert left_out.seen.tolist() == [False, True] * 15
    first, second = states_of([left_out, all_in])
    assert first == second


@pytest.mark.parametrize("kind", ["plain", "dueling-apart"])
@pytest.mark.parametrize("switches", [{}, {"target_tau": 0.1}])
def test_a_restored_learner_has_seen_what_the_first_had(switches, kind):
    config = DqnConfig(learning_rate=3e-4, batch_size=20, learn_every_steps=1, **switches)
    network, rng = build_network(NetworkConfig(kind=kind, hidden=(16, 8)), 30, 5, seed=1), np.random.default_rng(1)
    straight, restored = fused_of(config, network), fused_of(config, network)
    restored.update(transitions(rng, 20, 30, 5))  # whatever it has learned before
    batch = transitions(rng, 20, 30, 5)
    batch.observation_tm1[:, ::2] = 0
    straight.update(batch)
    restored.restore(straight.state())
    assert restored.seen.tolist() == straight.seen.tolist()
    for learner in (straight, restored):
        learner.update(batch)
    first, second = states_of([straight, restored])
    assert first == second


@pytest.mark.parametrize("kind", ["plain", "dueling-apart"])
def test_what_is_not_a_number_is_an_error_and_changes_nothing(kind):
    network = build_network(NetworkConfig(kind=kind, hidden=(4,)), 6, 3, seed=1)
    dqn = fused_of(DqnConfig(learning_rate=0.1, batch_size=1, learn_every_steps=1), network)
    batch = transitions(np.random.default_rng(1), 2, 6, 3)
    batch.observation_tm1[0, 3] = np.nan
    [before] = states_of([dqn])
    with pytest.raises(FloatingPointError, match="the loss is nan"):
        dqn.update(batch)
    assert states_of([dqn]) == [before]


def test_moments_fade_to_zero():
    values, mean, square = np.zeros(1, np.float32), np.full(1, LEAST), np.full(1, LEAST)
    scalars = np.float32(1), np.float32(0.1), np.float32(1)
    move(values, np.zeros(1, np.float32), mean, square, *scalars)
    assert mean == square == values == 0


def assert_each_takes_the_state_of_the_other(first, second):
    for learner, other in ((first, second), (second, first)):
        other.restore(learner.state())
        assert list(other.state()) == list(learner.state())
        for name, array in learner.state().items():
            np.testing.assert_array_equal(other.state()[name], array, err_msg=name)


@pytest.mark.parametrize("kind", KINDS)
def test_states_of_action_values_are_those_of_the_updates_by_autograd(kind):
    config = DqnConfig(learning_rate=3e-4, batch_size=20, learn_every_steps=1, target_tau=0.1)
    network, rng = build_network(NetworkConfig(kind=kind, hidden=(16, 8)), 30, 5, seed=1), np.random.default_rng(1)
    fused, plain = fused_of(config, network), Dqn(config, network)
    fused.update(transitions(rng, 20, 30, 5))
    assert_each_takes_the_state_of_the_other(fused, plain)


def test_states_of_policies_are_those_of_the_updates_by_autograd():
    rng = np.random.default_rng(1)
    network = actor_critic((16, 8), 30, 5)
    policy, batch = FusedPolicy(first_of(network), 1e-3, 0.5), experience(rng, 20, 30, 5)
    Ppo(PpoConfig(learning_rate=1e-3, epochs=1), policy).update(sparse_rows(batch.observation_tm1), batch)
    assert_each_takes_the_state_of_the_other(policy, PolicyNetwork(network, 1e-3, 0.5))
