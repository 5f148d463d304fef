"""The trainer: when it learns, and that it goes on after a restore."""

import hashlib
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_episodes import (
    STEPS,
    at_offset,
    cut,
    decided,
    edited,
    make_episode,
    with_following,
)

from railctl.common.rules import settings_of
from railctl.services.learner.learning import Learning, build_trainer

VARIANTS = {
    "dqn": {"target_tau": None, "kind": "plain"},
    "ddqn": {"kind": "plain"},
    "dddqn": {},
    "dddqn apart": {"kind": "dueling-apart", "double": True},
    "classic double": {"double": True},
    "reversed double": {"double": "reversed"},
    "target an episode": {"target_every": "episode"},
    "prioritized": {"replay": "prioritized"},
    "prioritized less and less": {"replay": "prioritized", "alpha_end": 0.1},
    "drqn": {"kind": "recurrent"},
    "drqn prioritized": {"kind": "recurrent", "replay": "prioritized"},
    "drqn reversed double, target an episode": {"kind": "recurrent", "double": "reversed", "target_every": "episode"},
}


PLAYED = {"span": make_episode, "step": lambda number: with_following(make_episode(number))}


def make_learning(kind="dueling", replay="uniform", n_features=6, hidden=(16, 16), capacity=200, alpha_end=None, **dqn):
    settings = {"learning_rate": 0.001, "batch_size": 8, "learn_every_steps": 7, "target_tau": 0.01}
    if kind == "recurrent":
        settings["sequence_decisions"] = 4
    sections = {
        "network": {"hidden": hidden, "kind": kind},
        "dqn": settings | dqn,
        "replay": {"kind": replay, "capacity": capacity} | ({} if alpha_end is None else {"alpha_end": alpha_end}),
    }
    return Learning(5, 20, settings_of(rule_of(kind)).model_validate(sections), n_features, 5)


def rule_of(kind):
    return "drqn" if kind == "recurrent" else "dqn"


def make_trainer(**changes):
    return build_trainer(rule_of(changes.get("kind")), make_learning(**changes))


def decisions_at(*times, steps):
    """An episode of one truncated train that decides at these steps."""
    nothing = np.zeros(6, np.float32)
    return decided(0, [(time, 0, 0, nothing) for time in times], np.full((steps, 1), -1), [-1], nothing[None])


def weights_hash(trainer):
    state = hashlib.sha256()
    for name, array in trainer.weights().items():
        state.update(name.encode() + array.tobytes())
    return state.hexdigest()


def assert_same_state(ours, theirs):
    assert list(ours) == list(theirs)
    for name, array in ours.items():
        assert array.tobytes() == theirs[name].tobytes(), name


def test_updates_fall_on_every_kth_step_across_episodes():
    trainer = make_trainer(batch_size=1, learn_every_steps=3)
    episode = decisions_at(0, 1, 2, steps=5)
    assert [trainer.train(episode)["updates"] for _ in range(4)] == [1, 2, 2, 1]  # steps 3; 6, 9; 12, 15; 18
    assert trainer.state()["trainer/episodes"] == 4
    assert trainer.state()["trainer/steps"] == 20
    assert trainer.state()["trainer/updates"] == 6


def test_updates_wait_for_a_batch_of_completed_transitions():
    # Complete after steps 3, 4 and 6: there are two from step 4 on, so updates follow steps 4, 5 and 6.
    metrics = make_trainer(batch_size=2, learn_every_steps=1).train(decisions_at(0, 2, 3, steps=6))
    assert metrics["updates"] == 3
    assert metrics["transitions"] == 3


def test_a_transition_takes_part_in_the_update_of_the_step_that_completes_it():
    metrics = make_trainer(batch_size=3, learn_every_steps=6).train(decisions_at(0, 2, 3, steps=6))
    assert metrics["updates"] == 1


@settings(deadline=None, max_examples=30)
@given(
    st.sampled_from(list(PLAYED)),
    st.integers(0, 10_000),
    st.lists(st.sets(st.integers(1, STEPS - 1), max_size=6), min_size=3, max_size=3),
)
def test_it_does_not_matter_where_episodes_are_cut(transitions, number, places):
    changes = {"replay": "prioritized", "transitions": transitions, "target_every": ("update", "episode")[number % 2]}
    whole, parts = make_trainer(**changes), make_trainer(**changes)
    for after, cuts in enumerate(places):
        episode = PLAYED[transitions](number + after)
        told = whole.train(episode)
        fragments = [parts.train(fragment) for fragment in cut(episode, cuts)]
        for name in ("updates", "transitions"):
            assert sum(fragment[name] for fragment in fragments) == told[name]
    assert_same_state(whole.state(), parts.state())


@pytest.mark.parametrize("kind", ["recurrent", "dueling"])
@pytest.mark.parametrize("every", ["update", "episode"])
def test_a_target_follows_after_updates_or_at_the_end_of_episodes(kind, every):
    trainer = make_trainer(kind=kind, target_every=every, target_tau=0.5)
    targets = [target_of(trainer)]
    for fragment in (*cut(make_episode(1), [9, 20, 31]), make_episode(2)):
        trainer.train(fragment)
        targets.append(target_of(trainer))
    changed = [not np.array_equal(*pair) for pair in itertools.pairwise(targets)]
    assert changed == ([True] * 5 if every == "update" else [False, False, False, True, True])
    network, target = (trainer.state()[f"algorithm/{part}/value.bias"] for part in ("network", "target"))
    assert not np.array_equal(network, target)


def target_of(trainer):
    return trainer.state()["algorithm/target/hidden.0.weight"]


@pytest.mark.parametrize("transitions", PLAYED)
@pytest.mark.parametrize("after", [1, 2, 3])
def test_a_trainer_restored_within_an_episode_goes_on_with_the_same_bits(after, transitions):
    every = "episode" if transitions == "step" else "update"
    changes = {"replay": "prioritized", "transitions": transitions, "target_every": every}
    straight, restored = make_trainer(**changes), make_trainer(**changes)
    first, second, third, other = map(PLAYED[transitions], (0, 1, 2, 99))
    straight.train(first)
    fragments = cut(second, [9, 20, 31])
    for fragment in fragments[:after]:
        straight.train(fragment)
    restored.train(cut(other, [7])[0])  # what was open there before must not matter
    restored.restore(straight.state(), fragments[:after])
    for fragment in (*fragments[after:], third):
        assert straight.train(fragment) == restored.train(fragment)
    assert_same_state(straight.state(), restored.state())


def test_an_update_knows_nothing_of_what_completes_later():
    episode = make_episode(3)
    rewards = episode.course.rewards.copy()
    rewards[21:] *= 9
    hashes = []
    for candidate in (episode, edited(episode, rewards=rewards)):
        trainer = make_trainer(learn_every_steps=21)
        assert trainer.train(candidate)["updates"] == 1
        hashes.append(weights_hash(trainer))
        trainer.train(make_episode(4))
        hashes.append(weights_hash(trainer))
    assert hashes[0] == hashes[2]  # after step 21
    assert hashes[1] != hashes[3]  # after step 42


def test_metrics_are_means_over_the_updates():
    trainer = make_trainer()
    metrics = trainer.train(make_episode(1))
    always = {"updates", "transitions", "replay_fill"}
    assert set(metrics) == {*always, "loss", "mean_q", "td_error", "gradient_norm"}
    assert metrics["td_error"] > 0
    assert set(make_trainer(batch_size=200).train(make_episode(1))) == always
    assert set(make_trainer(replay="prioritized").train(make_episode(1))) == {*metrics, "priority_mean", "priority_max"}


def test_an_episode_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="episode 1 has 7 features, the network 6"):
        make_trainer().train(make_episode(1, n_features=7))


def test_an_episode_of_another_kind_of_transitions_is_refused():
    with pytest.raises(ValueError, match="episode 1 has 0 features a step later, the rule wants 6"):
        make_trainer(transitions="step").train(PLAYED["span"](1))
    with pytest.raises(ValueError, match="episode 1 has 6 features a step later, the rule wants 0"):
        make_trainer().train(PLAYED["step"](1))


def test_weights_are_a_copy():
    trainer = make_trainer()
    trainer.weights()["value.bias"][:] = 9
    assert not (trainer.weights()["value.bias"] == 9).any()


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_restored_trainer_goes_on_with_the_same_bits(variant):
    straight = make_trainer(**VARIANTS[variant])
    for number in range(6):  # more than the replay holds
        straight.train(make_episode(number))
    restored = make_trainer(**VARIANTS[variant])
    restored.train(make_episode(99))  # what was there before must not matter
    restored.restore({name: at_offset(array, 1) for name, array in straight.state().items()})
    for number in range(6, 12):
        assert straight.train(make_episode(number)) == restored.train(make_episode(number))
    assert_same_state(straight.state(), restored.state())


def test_prioritised_errors_weigh_more_and_more_alike():
    """Beta goes from its first value to 1 over the run."""
    trainer = make_trainer(replay="prioritized")
    seen = []
    sample = trainer._replay.sample
    trainer._replay.sample = lambda size, key, beta: seen.append(beta) or sample(size, key, beta)
    for number in range(20):
        trainer.train(make_episode(number))
    betas = sorted(set(seen))
    np.testing.assert_allclose(betas[-20:], 0.4 + 0.6 * np.arange(20) / 20)
    assert seen == sorted(seen)


def test_priorities_count_less_and_less():
    trainer = make_trainer(replay="prioritized", alpha_end=0.0)
    for number in range(20):
        trainer.train(make_episode(number))
    assert set(trainer.state()["replay/priorities"].tolist()) == {1.0}  # uniform after the last episode


def test_a_state_holds_the_counters_as_integers():
    state = make_trainer().state()
    assert {name: state[name].dtype for name in state if name.startswith("trainer/")} == {
        "trainer/episodes": np.int64,
        "trainer/steps": np.int64,
        "trainer/updates": np.int64,
    }


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trainer/steps": None}, "trainer/steps is missing"),
        ({"other/x": np.zeros(1)}, "other/x is unknown"),
        ({"replay/cursor": None}, "cursor is missing"),
        ({"algorithm/network/value.bias": None}, r"network/value\.bias is missing"),
    ],
)
def test_a_state_that_does_not_fit_is_refused(change, message):
    trainer = make_trainer()
    state = {name: array for name, array in (trainer.state() | change).items() if array is not None}
    with pytest.raises(ValueError, match=message):
        trainer.restore(state)
