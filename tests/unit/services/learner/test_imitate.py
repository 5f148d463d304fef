"""Imitation of a teacher: which decisions are lessons, updates beside torch's, and what is kept."""

import numpy as np
import pytest
from made_episodes import course_of, decisions_of, edited, make_episode
from made_networks import first_of
from test_plain_policy import batches

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.networks import export_parameters
from railctl.common.rules.imitate import Settings
from railctl.common.rules.settings import NetworkConfig
from railctl.services.learner.algorithms.imitate import METRICS
from railctl.services.learner.fused.policy import FusedPolicy
from railctl.services.learner.learning import Learning, build_trainer
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.policies import PolicyNetwork


def settings(**changes):
    fields = {"learning_rate": 0.01, "updates": 2, "batch_size": 8, "max_gradient_norm": 5.0} | changes
    network = {"hidden": [8]}
    return Settings.model_validate({"network": network, "imitation": fields, "replay": {"capacity": 1000}})


def trainer(episodes=4, n_features=6, **changes):
    return build_trainer("imitate", Learning(1, episodes, settings(**changes), n_features))


@pytest.mark.parametrize("hidden", [(8,), (8, 5)])
def test_updates_are_those_of_torch(hidden):
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=hidden), 6, 3, seed=1)
    ours, theirs = FusedPolicy(first_of(network), 9.0, 0.1), PolicyNetwork(network, 9.0, 0.1)
    for number, batch in enumerate(batches(20)):
        told = 0.5, 0.003 / (1 + number), sparse_rows(batch.observation_tm1), batch
        np.testing.assert_allclose(ours.clone(*told), theirs.clone(*told), atol=1e-5)
    for name, array in theirs.weights().items():
        np.testing.assert_allclose(ours.weights()[name], array, atol=1e-4, err_msg=name)


def test_an_update_by_hand_knows_what_was_allowed():
    network = build_actor_critic(NetworkConfig(kind="actor-critic", hidden=(8,)), 6, 3, seed=1)
    [batch] = batches(1, size=2)
    batch = batch._replace(action_tm1=np.array([1, 0]), allowed_tm1=np.array([0b010, 0b101]))
    cross_entropy, _, agreement, *_ = FusedPolicy(first_of(network), 1.0, 1.0).clone(
        0.0, 0.1, sparse_rows(batch.observation_tm1), batch
    )
    weights = export_parameters(network)
    seen = np.float64(batch.observation_tm1[1])
    hidden = np.tanh(seen @ weights["actor_hidden.0.weight"].T + weights["actor_hidden.0.bias"])
    logits = hidden @ weights["actor.weight"].T + weights["actor.bias"]
    expected = np.log1p(np.exp(logits[2] - logits[0])) / 2  # the first had no choice
    assert cross_entropy == pytest.approx(expected, rel=1e-4)
    assert agreement == (1 + (logits[0] >= logits[2])) / 2


def test_lessons_are_what_the_teacher_would_do_if_it_knows_and_is_allowed_to():
    seen = np.eye(4, 6, dtype=np.float32)
    decided = [(step, 0, 2, seen[step]) for step in range(4)]
    decisions = decisions_of(decided, 6, allowed=[0b11100, 0b10100, 0b11111, 0b00100])
    decisions = decisions.model_copy(update={"labels": np.array([3, 1, -1, 2], np.int8)})
    lesson = trainer()._lesson(course_of([[-1]] * 4, [-1], decisions))
    assert lesson.decisions.times.tolist() == [0, 3]
    assert lesson.decisions.actions.tolist() == [3, 2]


ADVICE = np.array([-1, 2, 4, 3], np.int8)


def taught(number):
    """An episode with advice in three quarters of its decisions."""
    fragment = make_episode(number)
    return edited(fragment, labels=np.resize(ADVICE, len(fragment.course.decisions)))


def run(state=None, first=0, last=4):
    learner = trainer(n_features=make_episode(0).course.decisions.observations.shape[1])
    if state is not None:
        learner.restore(state)
    told = [learner.train(taught(number)) for number in range(first, last)]
    return learner, told


def test_it_goes_on_from_its_state_to_the_bit():
    whole, told = run()
    assert set(METRICS) <= set(told[-1])
    half, _ = run(last=2)
    rest, _ = run(half.state(), first=2)
    ours, theirs = whole.state(), rest.state()
    assert {name: array.tobytes() for name, array in ours.items()} == {
        name: array.tobytes() for name, array in theirs.items()
    }
    assert int(ours["rule/episodes"]) == 4


def test_the_learning_rate_falls_to_a_hundredth():
    rates = []
    learner = trainer(episodes=4, n_features=make_episode(0).course.decisions.observations.shape[1])
    learner._network.clone = lambda _weight, rate, _x, _batch: rates.append(rate) or np.zeros(5)
    for number in range(6):
        learner.train(taught(number))
    assert rates[::2] == pytest.approx([0.01, 0.0075, 0.005, 0.0025, 0.0001, 0.0001])


def test_the_share_of_the_teacher_falls_to_nothing():
    config = Settings.model_validate(settings().model_dump() | {"teacher": {"share": 0.8, "decay_share": 0.5}})
    assert [config.epsilon(episode, 8) for episode in (0, 1, 2, 4, 7)] == pytest.approx([0.8, 0.6, 0.4, 0, 0])
    assert config.teaching == (10, 4, 16)
