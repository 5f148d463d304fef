"""The trainer: when it learns, that it goes on after a restore, and that every process gets the same bits.

Run as a program it trains briefly on arrays at a given misalignment and prints a hash of the weights.
"""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from common.config import DqnConfig, NetworkConfig, ReplayConfig
from common.records import Episode
from services.learner.training import Trainer

STEPS, TRAINS = 40, 3


def make_trainer(n_features=6, hidden=(16, 16), capacity=200, **dqn):
    settings = {
        "learning_rate": 0.001,
        "batch_size": 8,
        "learn_every_steps": 7,
        "target_tau": 0.01,
    }
    return Trainer(
        seed=5,
        discount=0.99,
        network=NetworkConfig(hidden=hidden, kind="dueling"),
        dqn=DqnConfig(**(settings | dqn)),
        replay=ReplayConfig(capacity=capacity),
        n_features=n_features,
        n_actions=5,
    )


def at_offset(array, offset):
    """A copy of an array, `offset` bytes into its memory."""
    raw = np.zeros(array.nbytes + offset, np.uint8)[offset:].view(array.dtype).reshape(array.shape)
    raw[...] = array
    return raw


def make_episode(number, n_features=6, steps=STEPS, offset=0):
    """A random episode: a train decides on half of its steps until it arrives, if it does."""
    rng = np.random.default_rng(number)
    arrived_at = np.where(rng.random(TRAINS) < 0.5, rng.integers(0, steps, TRAINS), -1).astype(np.int32)
    until = np.where(arrived_at >= 0, arrived_at + 1, steps)
    deciding = (rng.random((steps, TRAINS)) < 0.5) & (np.arange(steps)[:, None] < until)
    times, trains = np.nonzero(deciding)
    final = -rng.random((TRAINS, n_features), np.float32)
    return Episode(
        episode=number,
        fragment=0,
        first_step=0,
        over=True,
        level="easy",
        level_seed=1,
        level_hash="0" * 32,
        weights_version=number,
        actor="a",
        acting_s=0.0,
        waited_s=0.0,
        max_steps=steps,
        observations=at_offset(-rng.random((len(times), n_features), np.float32), offset),
        times=times.astype(np.int32),
        trains=trains.astype(np.int32),
        actions=rng.integers(0, 5, len(times)).astype(np.int8),
        log_probabilities=np.zeros(len(times), np.float32),
        values=np.zeros(len(times), np.float32),
        rewards=at_offset(-(np.arange(steps)[:, None] < until).astype(np.float32), offset),
        arrived_at=arrived_at,
        final_observations=at_offset(final * (arrived_at < 0)[:, None], offset),
        states=np.zeros((TRAINS, 0), np.float32),
    )


def decisions_at(*times, steps):
    """An episode of one truncated train that decides at these steps."""
    return make_episode(0, steps=steps).model_copy(
        update={
            "times": np.array(times, np.int32),
            "trains": np.zeros(len(times), np.int32),
            "actions": np.zeros(len(times), np.int8),
            "observations": np.zeros((len(times), 6), np.float32),
            "rewards": np.full((steps, 1), -1, np.float32),
            "arrived_at": np.array([-1], np.int32),
            "log_probabilities": np.zeros(len(times), np.float32),
            "values": np.zeros(len(times), np.float32),
            "states": np.zeros((1, 0), np.float32),
            "final_observations": np.zeros((1, 6), np.float32),
        }
    )


def weights_hash(trainer):
    state = hashlib.sha256()
    for name, array in trainer.weights().items():
        state.update(name.encode() + array.tobytes())
    return state.hexdigest()


def test_updates_fall_on_every_kth_step_across_episodes():
    trainer = make_trainer(batch_size=1, learn_every_steps=3)
    episode = decisions_at(0, 1, 2, steps=5)
    assert [trainer.train(episode)["updates"] for _ in range(4)] == [1, 2, 2, 1]  # steps 3; 6, 9; 12, 15; 18
    assert trainer.episodes == 4
    assert trainer.state()["trainer/steps"] == 20
    assert trainer.state()["trainer/updates"] == 6


def test_updates_wait_for_a_batch_of_completed_transitions():
    # Complete after steps 2, 3 and 6: there are two from step 3 on, so updates follow steps 3, 4, 5 and 6.
    metrics = make_trainer(batch_size=2, learn_every_steps=1).train(decisions_at(0, 2, 3, steps=6))
    assert metrics["updates"] == 4
    assert metrics["transitions"] == 3


def test_a_transition_takes_part_in_the_update_of_the_step_that_completes_it():
    metrics = make_trainer(batch_size=3, learn_every_steps=6).train(decisions_at(0, 2, 3, steps=6))
    assert metrics["updates"] == 1


def test_an_update_knows_nothing_of_what_completes_later():
    episode = make_episode(3)
    rewards = episode.rewards.copy()
    rewards[21:] *= 9
    hashes = []
    for candidate in (episode, episode.model_copy(update={"rewards": rewards})):
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
    assert set(metrics) == {"updates", "transitions", "loss", "mean_q", "gradient_norm"}
    assert metrics["loss"] > 0
    assert set(make_trainer(batch_size=200).train(make_episode(1))) == {"updates", "transitions"}


def test_an_episode_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="episode 1 has 7 features, the network 6"):
        make_trainer().train(make_episode(1, n_features=7))


def test_weights_are_a_copy():
    trainer = make_trainer()
    trainer.weights()["value.bias"][:] = 9
    assert not (trainer.weights()["value.bias"] == 9).any()


@pytest.mark.parametrize("switches", [{}, {"double": True}, {"target_tau": None}])
def test_a_restored_trainer_goes_on_with_the_same_bits(switches):
    straight = make_trainer(**switches)
    for number in range(6):  # more than the replay holds
        straight.train(make_episode(number))
    restored = make_trainer(**switches)
    restored.train(make_episode(99))  # what was there before must not matter
    restored.restore({name: at_offset(array, 1) for name, array in straight.state().items()})
    for number in range(6, 12):
        assert straight.train(make_episode(number)) == restored.train(make_episode(number))
    ours, theirs = straight.state(), restored.state()
    assert list(ours) == list(theirs)
    for name, array in ours.items():
        assert array.tobytes() == theirs[name].tobytes(), name


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


def test_fresh_processes_agree_to_the_bit_at_any_alignment():
    environment = os.environ | {"MKL_CBWR": "AUTO,STRICT", "OMP_NUM_THREADS": "1"}
    results = [
        subprocess.run(
            [sys.executable, __file__, str(offset)],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        for offset in (0, 4, 13)
    ]
    assert not any(result.returncode for result in results), results
    assert len({result.stdout for result in results}) == 1
    assert len(results[0].stdout.strip()) == 64


def train_briefly(offset):
    """About 50 updates of the size of the real ones."""
    trainer = make_trainer(n_features=252, hidden=(128, 128), batch_size=150, learn_every_steps=4, capacity=5000)
    updates = sum(trainer.train(make_episode(number, 252, offset=offset))["updates"] for number in range(9))
    if updates < 45:
        raise RuntimeError(f"only {updates} updates")
    return weights_hash(trainer)


if __name__ == "__main__":
    from common.policy.determinism import deterministic_torch

    deterministic_torch()
    sys.stdout.write(train_briefly(int(sys.argv[1])))
