"""The trainers of policies: what they refuse, and that they go on after a restore."""

import numpy as np
import pytest
from made_episodes import at_offset, edited, make_episode
from test_training import weights_hash

from railctl.common.rules import settings_of
from railctl.services.learner.learning import Learning, build_trainer
from railctl.services.learner.returns import standardised
from railctl.services.learner.sparse import sparse_rows

RULES = ("ppo", "ppor", "sil")


def make_trainer(
    rule,
    n_features=6,
    hidden=(16, 16),
    capacity=120,
    discount=0.99,
    batch_size=32,
    returns="scaled",
    off_policy=False,
):
    ppo = {"learning_rate": 0.001, "epochs": 4, "returns": returns}
    sections = {
        "ppo": {"ppo": ppo},
        "ppor": {"ppo": ppo | {"batch_size": batch_size}, "replay": {"capacity": capacity}},
        "sil": {
            "ppo": ppo,
            "replay": {"capacity": capacity, "beta": 0, "alpha_end": 0.2},
            "sil": {"epochs": 3, "batch_size": batch_size},
        },
    }
    given = sections[rule] | {"network": {"hidden": hidden}, "discount": discount}
    settings = settings_of(rule).model_validate(given)
    return build_trainer(rule, Learning(5, 100, settings, n_features, 5, off_policy=off_policy))


def make_policy_episode(number, n_features=6, offset=0):
    """A random episode, of a policy that was not sure."""
    episode = make_episode(number, n_features, offset=offset)
    rng = np.random.default_rng(number)
    count = len(episode.course.decisions)
    return edited(episode, log_probabilities=-1 - rng.random(count, np.float32), values=-rng.random(count, np.float32))


def without(episode, kept):
    """Only some of an episode's decisions."""
    return edited(episode, decisions=episode.course.decisions.chosen(kept))


METRICS = {
    "updates",
    "transitions",
    "policy_loss",
    "value_loss",
    "entropy",
    "value_error",
    "clip_share",
    "kl",
    "gradient_norm",
}
TOLD = {
    "ppo": METRICS,
    "ppor": METRICS | {"replay_fill"},
    "sil": METRICS
    | {"replay_fill", "priority_mean", "priority_max", "sil_policy_loss", "sil_value_loss", "sil_gain"}
    | {"sil_positive_share", "sil_gradient_norm"},
}


@pytest.mark.parametrize("rule", RULES)
def test_an_episode_gives_its_epochs_of_updates_and_their_metrics(rule):
    episode = make_policy_episode(1)
    metrics = make_trainer(rule).train(episode)
    assert set(metrics) == TOLD[rule]
    assert metrics["updates"] == {"ppo": 4, "ppor": 4, "sil": 7}[rule]
    assert metrics["transitions"] == len(episode.course.decisions) >= 32


@pytest.mark.parametrize("rule", RULES)
def test_an_episode_without_decisions_changes_nothing(rule):
    trainer = make_trainer(rule)
    trainer.train(make_policy_episode(1))
    before = weights_hash(trainer)
    metrics = trainer.train(without(make_policy_episode(2), np.zeros(0, np.int64)))
    assert metrics["updates"] == metrics["transitions"] == 0
    assert weights_hash(trainer) == before


@pytest.mark.parametrize("rule", RULES)
def test_a_train_that_never_decides_does_not_matter(rule):
    episode = make_policy_episode(1)
    episode = without(episode, episode.course.decisions.trains != 1)
    rewards, final = episode.course.rewards.copy(), episode.course.final_observations.copy()
    rewards[:, 1], final[1] = 9, 9
    hashes = set()
    for candidate in (episode, edited(episode, rewards=rewards, final_observations=final)):
        trainer = make_trainer(rule, batch_size=8)
        assert trainer.train(candidate)["updates"] > 0
        hashes.add(weights_hash(trainer))
    assert len(hashes) == 1


def test_a_truncated_train_is_worth_what_it_saw_last_and_an_arrived_one_is_not():
    episode = make_policy_episode(1)
    hashes = {}
    for arrived in (-1, 39):
        for seen in (-0.1, -0.9):
            trainer = make_trainer("ppo")
            final = np.full_like(episode.course.final_observations, seen)
            at = np.full(3, arrived, np.int32)
            trainer.train(edited(episode, arrived_at=at, final_observations=final))
            hashes[arrived, seen] = weights_hash(trainer)
    assert hashes[-1, -0.1] != hashes[-1, -0.9]
    assert hashes[39, -0.1] == hashes[39, -0.9]


def acted_by(trainer, number):
    """An episode whose decisions are as probable as the trainer's policy would have made them, and of its values."""
    episode = make_policy_episode(number)
    new = trainer.experience(episode.course)
    log_probabilities, values = trainer._network.reconsider(sparse_rows(new.observation_tm1), new)
    return edited(episode, log_probabilities=log_probabilities, values=values)


@pytest.mark.parametrize("rule", RULES)
def test_what_the_policy_acted_itself_needs_no_correction_and_gives_the_same_bits(rule):
    free, exact = make_trainer(rule, off_policy=True), make_trainer(rule)
    for number in range(3):
        episode = acted_by(exact, number)
        told, plain = free.train(episode), exact.train(episode)
        assert told == plain | {"clipped_ratio": 1.0}
    assert weights_hash(free) == weights_hash(exact)


@pytest.mark.parametrize("rule", RULES)
def test_what_the_policy_would_hardly_do_any_more_hardly_counts(rule):
    """However good it was: decisions that were certain then, of which the policy now thinks one in five."""
    trainer = make_trainer(rule, off_policy=True)
    episode = acted_by(trainer, 1)
    sure = edited(episode, log_probabilities=np.zeros(len(episode.course.decisions), np.float32))
    plain = trainer.experience(sure.course)
    learned, ratios = trainer._corrected(sure.course, plain)
    now, values = trainer._network.reconsider(sparse_rows(plain.observation_tm1), plain)
    np.testing.assert_allclose(ratios, np.exp(now), rtol=1e-6)
    assert ratios.mean() < 0.5  # some had no choice
    assert abs(learned.return_t - values).mean() < abs(plain.return_t - values).mean()
    assert (learned.log_probability_tm1.tobytes(), learned.value_tm1.tobytes()) == (now.tobytes(), values.tobytes())
    assert learned.least_return_t.tobytes() == plain.least_return_t.tobytes()  # imitation looks at what came of it
    assert trainer.train(sure)["clipped_ratio"] == pytest.approx(ratios.mean())


def test_an_episode_without_decisions_needs_no_correction():
    trainer = make_trainer("ppo", off_policy=True)
    assert "clipped_ratio" not in trainer.train(without(make_policy_episode(2), np.zeros(0, np.int64)))


def test_who_learns_from_a_teacher_corrects_nothing():
    settings = settings_of("imitate").model_validate(
        {"imitation": {"learning_rate": 0.001, "updates": 1, "batch_size": 8}, "replay": {"capacity": 100}}
    )
    told, hashes = [], set()
    for off_policy in (False, True):
        trainer = build_trainer("imitate", Learning(5, 100, settings, 6, 5, off_policy=off_policy))
        episode = make_policy_episode(1)
        told.append(trainer.train(edited(episode, labels=episode.course.decisions.actions)))
        hashes.add(weights_hash(trainer))
    assert told[0] == told[1]
    assert told[0]["updates"] == len(hashes) == 1


def test_standardised_returns_by_hand():
    returns = np.array([-0.5, -0.1, -0.3], np.float32)  # mean -0.3, deviation sqrt(0.08 / 3)
    expected = np.array([-0.2, 0.2, 0]) / np.sqrt(0.08 / 3)
    np.testing.assert_allclose(standardised(returns, returns), expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(standardised(returns - np.float32(0.2), returns)[1], 0, atol=1e-6)
    assert standardised(returns[:1], returns[:1]).tolist() == [0]


@pytest.mark.parametrize("rule", RULES)
def test_returns_are_standardised_over_the_episode(rule):
    """With the critic's word, which is of standardised returns, as one of steps where the limit stops a train."""
    trainer = make_trainer(rule, returns="standardised")
    episode = make_policy_episode(1)
    course = episode.course.model_copy(update={"arrived_at": np.array([5, -1, -1], np.int32)})
    learned = trainer.experience(course)
    discount, rewards = 0.99, course.rewards.astype(np.float64)
    values = trainer._network.values(sparse_rows(course.final_observations))
    total = np.where(course.arrived_at < 0, values, 0).astype(np.float64)
    raw = np.empty(rewards.shape)
    for step in range(len(rewards) - 1, -1, -1):
        raw[step] = total = rewards[step] + discount * total
    decided = raw[course.decisions.times, course.decisions.trains]
    expected = (decided - decided.mean()) / decided.std()
    np.testing.assert_allclose(learned.return_t, expected, rtol=1e-4, atol=1e-4)
    assert (learned.least_return_t <= learned.return_t + 1e-3).all()


def test_ppor_waits_for_a_batch():
    trainer = make_trainer("ppor")
    episode = make_policy_episode(1)
    assert trainer.train(without(episode, slice(0, 20)))["updates"] == 0
    assert trainer.train(without(episode, slice(0, 20)))["updates"] == 4


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"over": False}, "episode 1 is a fragment"),
        ({"observations": np.zeros((40, 7), np.float32)}, "episode 1 has 7 features, the network 6"),
    ],
)
def test_an_episode_that_does_not_fit_is_refused(rule, change, message):
    episode = without(make_policy_episode(1), slice(0, 40))
    assert len(episode.course.decisions) == 40
    with pytest.raises(ValueError, match=message):
        make_trainer(rule).train(edited(episode, **change))


@pytest.mark.parametrize("rule", RULES)
def test_a_discount_of_one_is_refused(rule):
    with pytest.raises(ValueError, match="less than 1"):
        make_trainer(rule, discount=1.0)


@pytest.mark.parametrize("rule", RULES)
def test_a_restored_trainer_goes_on_with_the_same_bits(rule):
    straight = make_trainer(rule)
    for number in range(5):  # more than the replay holds
        straight.train(make_policy_episode(number))
    restored = make_trainer(rule)
    restored.train(make_policy_episode(99))  # what was there before must not matter
    restored.restore({name: at_offset(array, 1) for name, array in straight.state().items()})
    for number in range(5, 10):
        assert straight.train(make_policy_episode(number)) == restored.train(make_policy_episode(number))
    ours, theirs = straight.state(), restored.state()
    assert list(ours) == list(theirs)
    for name, array in ours.items():
        assert array.tobytes() == theirs[name].tobytes(), name


@pytest.mark.parametrize(
    ("rule", "change", "message"),
    [
        ("ppo", {"other/x": np.zeros(1)}, "other/x is unknown"),
        ("ppo", {"rule/x": np.zeros(1)}, "x is unknown"),
        ("ppo", {"learner/network/critic.bias": None}, r"network/critic\.bias is missing"),
        ("ppor", {"rule/draws": None}, "draws is missing"),
        ("sil", {"rule/cursor": None}, "cursor is missing"),
    ],
)
def test_a_state_that_does_not_fit_is_refused(rule, change, message):
    trainer = make_trainer(rule)
    state = {name: array for name, array in (trainer.state() | change).items() if array is not None}
    with pytest.raises(ValueError, match=message):
        trainer.restore(state)
