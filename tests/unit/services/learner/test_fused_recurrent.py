"""The compiled recurrent update against torch's own LSTM and autograd in float64, and against itself."""

import copy

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from made_episodes import some_allowed
from made_networks import first_of
from test_fused import assert_each_takes_the_state_of_the_other, assert_gradients_of_first_step, assert_same_weights

from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.rules.drqn import RecurrentDqnConfig
from railctl.common.rules.settings import NetworkConfig
from railctl.services.learner.fused.drqn import FusedDrqn
from railctl.services.learner.textbook.allowing import allowed_only
from railctl.services.learner.textbook.dqn import Dqn
from railctl.services.learner.training import Batch

F, A = 21, 3


def config_of(rows=8, tau=0.1, **switches):
    return RecurrentDqnConfig(learning_rate=3e-4, batch_size=rows, learn_every_steps=1, target_tau=tau, **switches)


def recurrent(hidden, n_features=F, n_actions=A, seed=1):
    config = NetworkConfig(kind="recurrent", hidden=hidden)
    return build_recurrent_network(config, n_features, n_actions, seed)


def sequences(rng, begins, length, n_features):
    """[L, B, F], of which sequence i is zeros before step `begins[i]`; nothing seen later on is seen nevertheless."""
    x = rng.standard_normal((length, len(begins), n_features)).astype(np.float32)
    x *= rng.random(x.shape) < 0.4
    for row, begin in enumerate(begins):
        x[:begin, row] = 0
        x[begin : begin + 1, row, 0] = 1
        x[begin + 1 : begin + 2, row] = 0
    return x


def batch_of(seed, begins_tm1, begins_t, length, n_features=F, n_actions=A):
    rng, rows = np.random.default_rng(seed), len(begins_tm1)
    return Batch(
        observation_tm1=sequences(rng, begins_tm1, length, n_features),
        action_tm1=rng.integers(n_actions, size=rows),
        reward_t=-rng.random(rows, np.float32),
        discount_t=rng.choice([0, 0.9], rows).astype(np.float32),
        allowed_t=some_allowed(rng, n_actions, rows),
        observation_t=sequences(rng, begins_t, length, n_features),
        weights=rng.random(rows, np.float32),
    )


def last_values(network, x, begins):
    """[B, A], each sequence run from its start."""
    return torch.cat([network(torch.tensor(x[begin:, [row]]).double())[0][-1] for row, begin in enumerate(begins)])


class ByAutograd:
    """The update as a textbook writes it, each sequence from its own start."""

    def __init__(self, config, network):
        self.network = copy.deepcopy(network).double()
        self.target, self._config = copy.deepcopy(self.network), config
        self._optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate)

    def update(self, batch, begins_tm1, begins_t):
        with torch.no_grad():
            picks, scores = {
                False: (self.target, self.target),
                True: (self.network, self.target),
                "reversed": (self.target, self.network),
            }[self._config.double]
            picking = allowed_only(last_values(picks, batch.observation_t, begins_t), torch.tensor(batch.allowed_t))
            scored = last_values(scores, batch.observation_t, begins_t)
            best = scored.gather(1, picking.argmax(1, keepdim=True))[:, 0]
            target = torch.tensor(batch.reward_t).double() + torch.tensor(batch.discount_t).double() * best
        values = last_values(self.network, batch.observation_tm1, begins_tm1)
        taken = values[torch.arange(len(values)), torch.tensor(batch.action_tm1)]
        self._optimizer.zero_grad()
        (torch.tensor(batch.weights).double() * (taken - target) ** 2).mean().backward()
        self._optimizer.step()
        with torch.no_grad():
            for slow, fast in zip(self.target.parameters(), self.network.parameters(), strict=True):
                slow.lerp_(fast, self._config.target_tau)


@settings(deadline=None, max_examples=20)
@given(
    st.sampled_from([(8,), (16, 33), (5, 17, 9)]),
    st.integers(1, 5),
    st.sampled_from([False, True, "reversed"]),
    st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=14),
    st.integers(0, 2**31),
)
def test_gradients_are_those_of_autograd_wherever_sequences_begin(hidden, length, double, begins, seed):
    begins_tm1, begins_t = ([min(begin, length - 1) for begin in column] for column in zip(*begins, strict=True))
    network, config = recurrent(hidden), config_of(len(begins), double=double)
    ours, theirs = FusedDrqn(config, first_of(network)), ByAutograd(config, network)
    batch = batch_of(seed, begins_tm1, begins_t, length)
    other = recurrent(hidden, seed=2)  # whose targets are of other actions
    theirs.target.load_state_dict(other.state_dict())
    ours.restore(ours.state() | {f"target/{name}": array for name, array in first_of(other).weights.items()})
    ours.update(batch)
    theirs.update(batch, begins_tm1, begins_t)
    assert_gradients_of_first_step(ours.state(), theirs.network)


def test_ten_updates_end_where_torch_does():
    network, config = recurrent((128, 128), 252, 5), config_of(60, tau=0.05)
    ours, theirs = FusedDrqn(config, first_of(network)), ByAutograd(config, network)
    begins = [number % 3 for number in range(60)]
    for seed in range(10):
        batch = batch_of(seed, begins, begins, 4, 252, 5)
        ours.update(batch)
        theirs.update(batch, begins, begins)
    assert_same_weights(ours.weights(), theirs.network)


def test_the_order_of_sequences_makes_no_difference_to_their_errors():
    begins = [3, 0, 2, 0, 1, 3, 0]
    batch, order = batch_of(1, begins, begins, 4), np.array([4, 2, 6, 0, 5, 1, 3])
    mixed = Batch(*(column[:, order].copy() if column.ndim == 3 else column[order] for column in batch))
    straight, other = (FusedDrqn(config_of(7), first_of(recurrent((16, 8)))).update(one) for one in (batch, mixed))
    assert other.error_sizes.tobytes() == straight.error_sizes[order].tobytes()


def test_a_sequence_that_never_begins_is_worth_what_an_empty_state_is():
    network, batch = recurrent((8, 8)), batch_of(1, [0, 0], [0, 0], 3)
    batch.observation_tm1[:, 1] = 0
    batch = batch._replace(discount_t=np.zeros(2, np.float32), reward_t=np.zeros(2, np.float32))
    with torch.no_grad():
        x = torch.relu(network.hidden[0](torch.zeros(1, 8)))
        advantage = network.advantage(x)
        q = network.value(x) + advantage - advantage.mean()
    size = FusedDrqn(config_of(2), first_of(network)).update(batch).error_sizes[1]
    assert size == pytest.approx(abs(q[0, batch.action_tm1[1]].item()), rel=1e-5)


def test_what_is_not_a_number_is_an_error_and_changes_nothing():
    drqn, batch = FusedDrqn(config_of(2), first_of(recurrent((8,)))), batch_of(1, [0, 1], [0, 0], 3)
    batch.observation_tm1[1, 1, 3] = np.nan
    before = {name: array.tobytes() for name, array in drqn.state().items()}
    with pytest.raises(FloatingPointError, match="the loss is nan"):
        drqn.update(batch)
    assert {name: array.tobytes() for name, array in drqn.state().items()} == before


@pytest.mark.parametrize("hidden", [(16, 8), (5,)])
def test_states_are_those_of_the_updates_by_autograd(hidden):
    network, config = recurrent(hidden), config_of(4)
    fused = FusedDrqn(config, first_of(network))
    fused.update(batch_of(1, [0] * 4, [0] * 4, 3))
    assert_each_takes_the_state_of_the_other(fused, Dqn(config, network))
