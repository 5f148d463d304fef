"""python -m railctl.services.learner.selfcheck: some updates on made-up episodes; says a digest of the network they end in.

How it says it: see `common.task`. Run in two fresh processes, the digests agree if this machine's arithmetic repeats.
Buffers are shifted by a random number of bytes, since alignment is what makes unprepared arithmetic differ.
"""

import hashlib
import os

import numpy as np

from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.records.acting import Circumstances, Fragment, Lease
from railctl.common.records.course import Course, Decisions
from railctl.common.rules.dqn import QNetworkConfig, Settings
from railctl.common.rules.replay import PrioritizedReplay
from railctl.common.rules.values import DqnConfig
from railctl.common.task import Teller, carry_out, say
from railctl.services.learner.learning import Learning, build_trainer

N_FEATURES, N_ACTIONS, TRAINS, STEPS, EPISODES = 252, 5, 3, 60, 6


def made_up_episode(number: int, n_features: int = N_FEATURES) -> Fragment:
    """An episode whose content is a function of its number, in memory at a random alignment."""
    rng = np.random.Generator(np.random.Philox(key=number))
    count = TRAINS * STEPS
    shift = os.urandom(1)[0] % 16
    buffer = np.empty(shift + count * n_features, np.float32)
    observations = buffer[shift:].reshape(count, n_features)
    observations[:] = -rng.random((count, n_features), np.float32)
    actions = rng.integers(0, N_ACTIONS, count, np.int8)
    decisions = Decisions(
        observations=observations,
        times=np.repeat(np.arange(STEPS, dtype=np.int32), TRAINS),
        trains=np.tile(np.arange(TRAINS, dtype=np.int32), STEPS),
        actions=actions,
        allowed=np.full(count, ALL_ACTIONS, np.uint8),
        log_probabilities=np.zeros(count, np.float32),
        values=np.zeros(count, np.float32),
        labels=actions,
        following=np.zeros((count, 0), np.float32),
    )
    course = Course(
        level_hash="0" * 32,
        max_steps=STEPS,
        first_step=0,
        over=True,
        decisions=decisions,
        rewards=np.full((STEPS, TRAINS), -1, np.float32),
        arrived_at=np.full(TRAINS, -1, np.int32),
        final_observations=np.zeros((TRAINS, n_features), np.float32),
        final_allowed=np.full(TRAINS, ALL_ACTIONS, np.uint8),
        states=np.zeros((TRAINS, 0), np.float32),
    )
    lease = Lease(
        episode=number,
        level="easy",
        level_seed=number,
        weights_version=number,
        epsilon=0.0,
        steps=None,
        progressed=None,
    )
    circumstances = Circumstances(actor="selfcheck", acting_s=0.0, waited_s=0.0)
    return Fragment(lease=lease, course=course, circumstances=circumstances)


def check() -> None:
    """Train, and say what came of it."""
    settings = Settings(
        network=QNetworkConfig(kind="dueling"),
        dqn=DqnConfig(learning_rate=3e-4, batch_size=150, learn_every_steps=5, target_tau=0.01),
        replay=PrioritizedReplay(capacity=1000),
    )
    learning = Learning(1, EPISODES, settings, N_FEATURES, N_ACTIONS)
    trainer = build_trainer("dqn", learning)
    teller = Teller("arithmetic")
    for number in range(EPISODES):
        trainer.train(made_up_episode(number))
        teller.tell(number + 1, EPISODES)
    state = hashlib.blake2b(digest_size=16)
    for name, array in sorted(trainer.weights().items()):
        state.update(name.encode() + array.tobytes())
    say({"digest": state.hexdigest()})


if __name__ == "__main__":
    carry_out(check)
