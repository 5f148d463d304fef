"""Episodes for tests of the learner: made up at random, by hand, and cut into fragments."""

import os
import subprocess

import numpy as np

from common.interpreter import PYTHON
from common.records import Episode

STEPS, TRAINS = 40, 3


def at_offset(array, offset):
    """A copy of an array, `offset` bytes into its memory."""
    raw = np.zeros(array.nbytes + offset, np.uint8)[offset:].view(array.dtype).reshape(array.shape)
    raw[...] = array
    return raw


def make_episode(number, n_features=6, steps=STEPS, offset=0, density=1.0):
    """A random episode: a train decides on half of its steps until it arrives, if it does."""
    rng = np.random.default_rng(number)
    arrived_at = np.where(rng.random(TRAINS) < 0.5, rng.integers(0, steps, TRAINS), -1).astype(np.int32)
    until = np.where(arrived_at >= 0, arrived_at + 1, steps)
    deciding = (rng.random((steps, TRAINS)) < 0.5) & (np.arange(steps)[:, None] < until)
    times, trains = np.nonzero(deciding)
    seen = -rng.random((len(times), n_features), np.float32) * (rng.random((len(times), n_features)) < density)
    final = -rng.random((TRAINS, n_features), np.float32)
    episode = decided(
        number,
        zip(times, trains, rng.integers(0, 5, len(times)), seen, strict=True),
        -(np.arange(steps)[:, None] < until).astype(np.float32),
        arrived_at,
        final * (arrived_at < 0)[:, None],
    )
    names = ("observations", "rewards", "final_observations")
    return episode.model_copy(update={name: at_offset(getattr(episode, name), offset) for name in names})


def decided(number, decisions, rewards, arrived_at, final):
    """An episode of `decisions`: (time, train, action, what it saw)."""
    times, trains, actions, seen = zip(*decisions, strict=True) if (decisions := list(decisions)) else ((), (), (), ())
    final = np.asarray(final, np.float32).reshape(len(arrived_at), -1)
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
        max_steps=len(rewards),
        observations=np.array(seen, np.float32).reshape(len(times), final.shape[1]),
        times=np.array(times, np.int32),
        trains=np.array(trains, np.int32),
        actions=np.array(actions, np.int8),
        log_probabilities=np.zeros(len(times), np.float32),
        values=np.zeros(len(times), np.float32),
        rewards=np.asarray(rewards, np.float32),
        arrived_at=np.array(arrived_at, np.int32),
        final_observations=final,
        states=np.zeros((len(arrived_at), 0), np.float32),
    )


def cut(episode, places):
    """The fragments of an episode cut after these steps, as an actor would have published them."""
    ends = sorted({place for place in places if 0 < place < len(episode.rewards)})
    fragments = []
    for number, (first, end) in enumerate(zip([0, *ends], [*ends, len(episode.rewards)], strict=True)):
        here, over = (first <= episode.times) & (episode.times < end), end == len(episode.rewards)
        changed = {name: getattr(episode, name)[here] for name in ("observations", "times", "trains", "actions")}
        changed |= {name: getattr(episode, name)[here] for name in ("log_probabilities", "values")}
        changed |= {
            "fragment": number,
            "first_step": first,
            "over": over,
            "rewards": episode.rewards[first:end],
            "arrived_at": np.where(episode.arrived_at < end, episode.arrived_at, -1).astype(np.int32),
            "final_observations": episode.final_observations * np.float32(over),
        }
        fragments.append(Episode.model_validate(dict(episode) | changed))
    return fragments


def printed_by_fresh_processes(program, offsets):
    """What a test file prints as a program, once for each misalignment of its arrays."""
    environment = os.environ | {"MKL_CBWR": "AUTO,STRICT", "OMP_NUM_THREADS": "1"}
    results = [
        subprocess.run([*PYTHON, program, str(offset)], env=environment, capture_output=True, text=True, check=False)
        for offset in offsets
    ]
    assert not any(result.returncode for result in results), results
    return [result.stdout for result in results]
