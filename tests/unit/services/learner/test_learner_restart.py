"""A learner that goes on from a snapshot can still hand out all that its leases name."""

from types import SimpleNamespace

import numpy as np
import pytest

from common.config import parse_config
from common.folder import RunFolder
from common.rail.normalise import N_FEATURES
from common.records import Empty, Episode, Lease, LeaseRequest, WeightsRequest
from common.wire import keys
from common.wire.keys import Alive
from services.learner.service import Learner


class Question:
    """A question that remembers its answer."""

    def __init__(self, request):
        self.request = request
        self.answered = self.refused = None

    def answer(self, record):
        self.answered = record

    def refuse(self, reason):
        self.refused = reason

    def drop(self):
        pass


class Wire:
    """The bus of a learner that a test talks to directly."""

    refused = 0

    def __init__(self):
        self.served, self.on_episode, self.on_alive = {}, None, None

    def publish(self, _topic, _record):
        pass

    def serve(self, service, on_question):
        self.served[service] = on_question

    def subscribe(self, topic, on_record):
        assert topic is keys.EPISODES
        self.on_episode = on_record

    def watch_alive(self, _key, on_change):
        self.on_alive = on_change


class Cluster:
    """A learner and what its actors would say."""

    def __init__(self, folder, config):
        self.wire = Wire()
        stopping = SimpleNamespace(asked=False)
        heart = SimpleNamespace(beat=lambda *_arguments, **_options: None)
        self.learner = Learner(
            SimpleNamespace(folder=folder, config=config, bus=self.wire, heart=heart, stopping=stopping)
        )
        self.learner._publish_weights()
        self.learner._open_doors()

    def come(self, *incarnations):
        for incarnation in incarnations:
            self.wire.on_alive(Alive("actor", incarnation, incarnation), True)

    def ask(self, service, request):
        question = Question(request)
        self.wire.served[service](question)
        self.turn()
        return question

    def turn(self):
        self.learner._take_messages(wait_s=0.0)
        while (episode := self.learner._ledger.next_ready()) is not None:
            self.learner._train_if_right(episode)
        self.learner._answer_parked()

    def lease(self, incarnation):
        request = LeaseRequest(
            actor=incarnation, incarnation=incarnation, serves="any", kept=np.zeros((0, 2), np.int64)
        )
        answer = self.ask(keys.LEASE, request).answered
        return None if answer is None else answer.lease

    def weights(self, version):
        return self.ask(keys.PULL_WEIGHTS, WeightsRequest(version=version)).answered

    def act(self, lease: Lease):
        self.wire.on_episode(acted(lease))
        self.turn()


def acted(lease):
    """An episode of one train that makes one decision and arrives."""
    return Episode(
        episode=lease.episode,
        fragment=0,
        first_step=0,
        over=True,
        level=lease.level,
        level_seed=lease.level_seed,
        level_hash="0" * 32,
        weights_version=lease.weights_version,
        actor="a",
        acting_s=0.0,
        waited_s=0.0,
        max_steps=4,
        observations=np.full((1, N_FEATURES), lease.episode / 10, np.float32),
        times=np.zeros(1, np.int32),
        trains=np.zeros(1, np.int32),
        actions=np.zeros(1, np.int8),
        log_probabilities=np.zeros(1, np.float32),
        values=np.zeros(1, np.float32),
        rewards=np.array([[-1], [0]], np.float32),
        arrived_at=np.ones(1, np.int32),
        final_observations=np.zeros((1, N_FEATURES), np.float32),
        states=np.zeros((1, 0), np.float32),
    )


def config(lag):
    return parse_config(
        {
            "algorithm": "dddqn",
            "mix": {"easy": 1.0},
            "episodes": 20,
            "lag": lag,
            "network": {"hidden": [4]},
            "dqn": {"learning_rate": 0.01, "batch_size": 1, "learn_every_steps": 1},
            "replay": {"capacity": 100},
            "rule": "dqn",
            "cluster": {"actors": {"easy": 1}},
        }
    )


@pytest.mark.parametrize("lag", [0, 2])
def test_a_restarted_learner_has_the_weights_that_its_leases_name(tmp_path, lag):
    folder = RunFolder(tmp_path)
    before = Cluster(folder, config(lag))
    before.come("one")
    handed_out = {0: before.weights(0)}
    for episode in range(6):
        lease = before.lease("one")
        assert lease.episode == episode
        before.act(lease)
        handed_out[episode + 1] = before.weights(episode + 1)
    assert len({weights.tensors[name].tobytes() for weights in handed_out.values() for name in weights.tensors}) > 7
    before.learner._save_snapshot()
    before.learner.close()

    after = Cluster(folder, config(lag))
    incarnations = [f"new-{number}" for number in range(lag + 1)]
    after.come(*incarnations)
    leases = [after.lease(incarnation) for incarnation in incarnations]
    after.learner.close()
    assert [lease.episode for lease in leases] == list(range(6, 7 + lag))
    for lease in leases:
        weights = after.weights(lease.weights_version)
        assert weights is not None, f"episode {lease.episode} waits for weights {lease.weights_version} for ever"
        for name, tensor in handed_out[lease.weights_version].tensors.items():
            assert weights.tensors[name].tobytes() == tensor.tobytes()


def test_a_checkpoint_is_listed_as_soon_as_it_is_written(tmp_path):
    cluster = Cluster(RunFolder(tmp_path), config(0))
    assert cluster.ask(keys.LIST_CHECKPOINTS, Empty()).answered.episodes == []
    cluster.learner._save_checkpoint()
    cluster.learner.close()
    assert cluster.ask(keys.LIST_CHECKPOINTS, Empty()).answered.episodes == [0]
