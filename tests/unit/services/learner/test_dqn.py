"""Targets and one whole update, worked by hand."""

import math

import numpy as np
import pytest
import torch
from made_networks import first_of

from railctl.common.policy.networks import build_network, import_parameters
from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.fused.dqn import FusedApart, FusedDqn
from railctl.services.learner.textbook.allowing import allowed_only
from railctl.services.learner.textbook.dqn import Dqn, double_q_target, error_gradient, q_target, soft_update
from railctl.services.learner.training import Batch

R_T = torch.tensor([-1.0, -2.0])
DISCOUNT_T = torch.tensor([0.5, 0.0])
Q_TARGET_T = torch.tensor([[1.0, 3.0, 2.0], [5.0, 6.0, 7.0]])


def test_q_target_by_hand():
    target = q_target(R_T, DISCOUNT_T, Q_TARGET_T)
    assert target.tolist() == [0.5, -2]  # -1 + 3/2; terminated


def test_double_q_target_by_hand():
    q_t = torch.tensor([[9.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    target = double_q_target(R_T, DISCOUNT_T, q_t, Q_TARGET_T)
    assert target.tolist() == [-0.5, -2]  # -1 + 1/2: the online net picks action 0


def test_a_reversed_target_by_hand():
    q_t = torch.tensor([[9.0, 4.0, 1.0], [0.0, 0.0, 1.0]])
    target = double_q_target(R_T, DISCOUNT_T, Q_TARGET_T, q_t)
    assert target.tolist() == [1, -2]  # -1 + 4/2: the target net picks action 1, which the online net gives a 4


def test_targets_of_allowed_actions_by_hand():
    allowed_t = torch.tensor([0b101, 0b011])
    only = allowed_only(Q_TARGET_T, allowed_t)
    assert q_target(R_T, DISCOUNT_T, only).tolist() == [0, -2]  # -1 + 2/2: the 3 is not allowed
    q_t = allowed_only(torch.tensor([[0.0, 9.0, 1.0], [0.0, 0.0, 1.0]]), allowed_t)
    assert double_q_target(R_T, DISCOUNT_T, q_t, only).tolist() == [0, -2]


def test_soft_update_by_hand():
    target, online = torch.tensor([4.0, 0.0]), torch.tensor([8.0, 1.0])
    soft_update(target, online, 0.25)
    assert target.tolist() == [5, 0.25]
    assert online.tolist() == [8, 1]
    soft_update(target, online, 1.0)
    assert torch.equal(target, online)


def test_error_gradient_by_hand():
    # mean(w * e^2) = (1 * 3^2 + 0.5 * 2^2) / 2: by the errors, w * e each.
    gradient = error_gradient(torch.tensor([3.0, -2.0]), torch.tensor([1.0, 0.5]), torch.tensor([2, 0]), 3)
    assert gradient.tolist() == [[0, 0, 3], [-1, 0, 0]]


def make_dqn(*, learner=FusedDqn, **switches):
    """Observation x >= 0 has the values (x, 3x)."""
    network = build_network(NetworkConfig(hidden=(1,)), n_features=1, n_actions=2, seed=0)
    import_parameters(
        network,
        {
            "hidden.0.weight": np.array([[1]], np.float32),
            "hidden.0.bias": np.array([0], np.float32),
            "q.weight": np.array([[1], [3]], np.float32),
            "q.bias": np.array([0, 0], np.float32),
        },
    )
    config = DqnConfig(learning_rate=0.1, batch_size=1, learn_every_steps=1, **switches)
    return learner(config, network if learner is Dqn else first_of(network))


def one_transition(allowed=0b11):
    return Batch(
        observation_tm1=np.array([[2.0]], np.float32),
        action_tm1=np.array([1]),
        reward_t=np.array([-1.0], np.float32),
        discount_t=np.array([0.5], np.float32),
        allowed_t=np.array([allowed]),
        observation_t=np.array([[1.0]], np.float32),
        weights=np.array([1.0], np.float32),
    )


def test_an_update_by_hand():
    dqn = make_dqn(target_tau=0.5)
    error_sizes, metrics = dqn.update(one_transition())
    assert error_sizes.tolist() == [5.5]
    # Q(2, 1) = 6, target -1 + 0.5 * max(1, 3) = 0.5, error 5.5; dloss/dq = 11, which reaches q.weight[1]
    # times 2, q.bias[1] times 1, hidden.weight times 3 * 2 and hidden.bias times 3.
    assert metrics["loss"] == pytest.approx(5.5**2)
    assert metrics["mean_q"] == pytest.approx(6)
    assert metrics["gradient_norm"] == pytest.approx(11 * math.sqrt(4 + 1 + 36 + 9))
    # The first step of Adam moves each parameter by the learning rate against the sign of its gradient.
    after = dqn.weights()
    assert after["q.weight"].flatten().tolist() == pytest.approx([1, 2.9])
    assert after["q.bias"].tolist() == pytest.approx([0, -0.1])
    assert after["hidden.0.weight"].item() == pytest.approx(0.9)
    assert after["hidden.0.bias"].item() == pytest.approx(-0.1)
    state = dqn.state()  # the target has gone half the way
    assert state["target/hidden.0.weight"].item() == pytest.approx(0.95)
    assert state["target/q.bias"].tolist() == pytest.approx([0, -0.05])


@pytest.mark.parametrize("learner", [FusedDqn, Dqn])
def test_a_target_that_follows_once_an_episode_stays_until_then(learner):
    dqn = make_dqn(learner=learner, target_tau=0.5, target_every="episode")
    before = dqn.state()
    dqn.update(one_transition())  # as above
    state = dqn.state()
    assert state["network/hidden.0.weight"].item() == pytest.approx(0.9)
    for name in [name for name in state if name.startswith("target/")]:
        assert state[name].tobytes() == before[name].tobytes()
    dqn.follow(0.5)
    state = dqn.state()
    assert state["target/hidden.0.weight"].item() == pytest.approx(0.95)
    assert state["target/q.bias"].tolist() == pytest.approx([0, -0.05])


@pytest.mark.parametrize("double", [False, True, "reversed"])
def test_targets_are_of_what_is_allowed(double):
    # Q(1, .) is (1, 3), and only the first may follow: target -1 + 0.5 * 1 = -0.5, and Q(2, 1) is 6
    assert make_dqn(double=double, target_tau=0.5).update(one_transition(0b01)).error_sizes.tolist() == [6.5]
    assert make_dqn(double=double, target_tau=0.5).update(one_transition(0b10)).error_sizes.tolist() == [5.5]


ONE = np.ones((1, 1), np.float32)
APART = {  # observation x >= 0 has the advantages (x, 3x) and the value 2x: action values (x, 3x), too
    "advantage_hidden.0.weight": ONE,
    "advantage_hidden.0.bias": np.zeros(1, np.float32),
    "advantage.weight": np.array([[1], [3]], np.float32),
    "advantage.bias": np.zeros(2, np.float32),
    "value_hidden.0.weight": 2 * ONE,
    "value_hidden.0.bias": np.zeros(1, np.float32),
    "value.weight": ONE,
    "value.bias": np.zeros(1, np.float32),
}


@pytest.mark.parametrize("learner", [FusedApart, Dqn])
def test_an_update_of_networks_that_share_nothing_by_hand(learner):
    network = build_network(NetworkConfig(kind="dueling-apart", hidden=(1,)), n_features=1, n_actions=2, seed=0)
    import_parameters(network, APART)
    config = DqnConfig(learning_rate=0.1, batch_size=1, learn_every_steps=1, target_tau=0.5)
    dqn = learner(config, network if learner is Dqn else first_of(network))
    error_sizes, metrics = dqn.update(one_transition())
    assert error_sizes.tolist() == [5.5]  # as above
    # dloss/dq = 11 reaches value.bias as it is, value.weight times 4, the hidden bias times 1, its weight times 2; the
    # advantages' biases times -1/2 and 1/2, their weights times 2 of that, the hidden bias times (3 - 1)/2, its weight
    # times 2 of that.
    by_value, by_advantages = (1, 4, 1, 2), (1 / 2, 1 / 2, 1, 1, 1, 2)
    expected = 11 * math.sqrt(sum(x * x for x in (*by_value, *by_advantages)))
    assert metrics["gradient_norm"] == pytest.approx(expected)
    state = dqn.state()
    moved = {name: state[f"network/{name}"] - array for name, array in APART.items()}
    assert moved["advantage.weight"].flatten().tolist() == pytest.approx([0.1, -0.1], rel=1e-5)
    for name in ("advantage_hidden.0.weight", "value_hidden.0.bias", "value_hidden.0.weight", "value.weight"):
        assert moved[name].item() == pytest.approx(-0.1, rel=1e-5)
    for name, array in APART.items():  # the target of both has gone half the way
        np.testing.assert_allclose(state[f"target/{name}"], array + moved[name] / 2, rtol=1e-5)


def test_a_weight_scales_the_loss_and_its_gradient():
    metrics = make_dqn().update(one_transition()._replace(weights=np.array([0.5], np.float32))).metrics
    assert metrics["loss"] == pytest.approx(5.5**2 / 2)
    assert metrics["td_error"] == pytest.approx(5.5)
    assert metrics["gradient_norm"] == pytest.approx(5.5 * math.sqrt(4 + 1 + 36 + 9))


@pytest.mark.parametrize("learner", [FusedDqn, Dqn])
# Of the best, of the online network's best (action 1, a 3), of the target network's best (action 0, online a 1):
@pytest.mark.parametrize(("double", "error"), [(False, 6 - 4), (True, 6 - 0.5), ("reversed", 6 + 0.5)])
def test_who_picks_the_action_of_the_target(learner, double, error):
    dqn = make_dqn(learner=learner, double=double, target_tau=0.01)
    state = dqn.state()
    state["target/q.weight"] = np.array([[10], [3]], np.float32)  # best is action 0; online it is action 1
    dqn.restore(state)
    assert dqn.update(one_transition()).metrics["loss"] == pytest.approx(error**2)


def test_without_a_target_network_there_is_none_to_keep():
    dqn = make_dqn()
    assert not [name for name in dqn.state() if name.startswith("target/")]
    dqn.update(one_transition())
    # Q(x) = relu(0.9 x - 0.1) * (1, 2.9) + (0, -0.1): the second target comes from the network as it is now.
    q_tm1, q_t = 1.7 * 2.9 - 0.1, 0.8 * 2.9 - 0.1
    assert dqn.update(one_transition()).metrics["loss"] == pytest.approx((q_tm1 - (-1 + 0.5 * q_t)) ** 2, rel=1e-5)


def test_divergence_is_an_error_that_leaves_the_network_alone():
    dqn = make_dqn()
    before = dqn.weights()
    with pytest.raises(FloatingPointError, match=r"lower dqn\.learning_rate"):
        dqn.update(one_transition()._replace(reward_t=np.array([math.inf], np.float32)))
    for name, array in dqn.weights().items():
        np.testing.assert_array_equal(array, before[name])


@pytest.mark.parametrize("target_tau", [None, 0.1])
def test_a_restored_learner_goes_on_with_the_same_bits(target_tau):
    dqn = make_dqn(target_tau=target_tau)
    for _ in range(3):
        dqn.update(one_transition())
    other = make_dqn(target_tau=target_tau)
    other.restore(dqn.state())
    for _ in range(3):
        assert dqn.update(one_transition()).metrics == other.update(one_transition()).metrics
    for name, array in dqn.weights().items():
        np.testing.assert_array_equal(array, other.weights()[name])
    assert sorted(dqn.state()) == sorted(make_dqn(target_tau=target_tau).state())


def test_a_state_that_does_not_fit_names_the_tensor():
    dqn = make_dqn()
    state = dqn.state()
    del state["exp_avg/q.bias"]
    with pytest.raises(ValueError, match=r"exp_avg/q\.bias is missing"):
        dqn.restore(state)
