"""A learner that goes on from a snapshot can still hand out all that its leases name."""

from types import SimpleNamespace

import numpy as np
import pytest

from common import checkpoint
from common.config import parse_config
from common.folder import RunFolder
from common.rail.normalise import N_FEATURES
from common.records.acting import Lease, LeaseRequest, WeightsRequest
from common.records.control import Empty
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
        heartbeat = SimpleNamespace(beat=lambda *_arguments, **_options: None)
        self.learner = Learner(
            SimpleNamespace(folder=folder, config=config, bus=self.wire, heartbeat=heartbeat, stopping=stopping)
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

    def question(self, incarnation, kept=()):
        units = np.array(kept, np.int64).reshape(-1, 2)
        request = LeaseRequest(actor=incarnation, incarnation=incarnation, serves="any", kept=units)
        return self.ask(keys.LEASE, request).answered

    def lease(self, incarnation):
        answer = self.question(incarnation)
        return None if answer is None else answer.lease

    def weights(self, version):
        return self.ask(keys.PULL_WEIGHTS, WeightsRequest(version=version)).answered

    def act(self, lease: Lease):
        self.bring(acted(lease))

    def bring(self, episode):
        self.wire.on_episode(episode)
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


def fragment(lease, number_of_them=3):
    """A fragment of an episode of one train that decides on every step and arrives on the last."""
    over, steps = lease.fragment == number_of_them - 1, lease.steps
    changes = {
        "fragment": lease.fragment,
        "first_step": lease.first_step,
        "over": over,
        "max_steps": 100,
        "observations": np.full((steps, N_FEATURES), lease.weights_version / 100, np.float32),
        "times": np.arange(lease.first_step, lease.first_step + steps, dtype=np.int32),
        "trains": np.zeros(steps, np.int32),
        "actions": np.full(steps, lease.fragment, np.int8),
        "log_probabilities": np.zeros(steps, np.float32),
        "values": np.zeros(steps, np.float32),
        "rewards": np.full((steps, 1), -1, np.float32),
        "arrived_at": np.array([lease.first_step + steps - 1 if over else -1], np.int32),
    }
    return Episode.model_validate(dict(acted(lease)) | changes)


def config(lag, **changes):
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
        | changes
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


def test_fragments_act_with_the_weights_after_the_one_before_and_end_where_updates_fall_due(tmp_path):
    cluster = Cluster(RunFolder(tmp_path), config(0, fragment_steps=4))
    cluster.come("one")
    seen = []
    for _ in range(7):
        lease = cluster.lease("one")
        seen.append((lease.episode, lease.fragment, lease.first_step, lease.steps, lease.weights_version))
        steps = 3 if lease.fragment == 2 else lease.steps  # an episode may be over before its lease is
        cluster.bring(fragment(lease.model_copy(update={"steps": steps})))
    cluster.learner.close()
    assert seen == [
        (0, 0, 0, 4, 0),
        (0, 1, 4, 4, 1),
        (0, 2, 8, 4, 2),
        (1, 0, 0, 1, 3),  # 11 steps are over: after the next one an update falls due
        (1, 1, 1, 4, 4),
        (1, 2, 5, 4, 5),
        (2, 0, 0, 1, 6),
    ]
    rows = cluster.learner._archive.rows
    assert [(row.steps, row.decisions, row.weights_version) for row in rows] == [(11, 11, 0), (8, 8, 3)]


def test_an_open_episode_comes_again_after_a_restart_kept_or_acted_anew_and_ends_in_the_same_weights(tmp_path):
    folder = RunFolder(tmp_path)
    before = Cluster(folder, config(0, fragment_steps=4))
    before.come("one")
    brought = []
    for _ in range(8):
        brought.append(fragment(before.lease("one")))
        before.bring(brought[-1])
        if len(brought) == 3:
            before.learner._save_snapshot()
    weights = before.weights(8)
    progressed = before.lease("one").progressed
    before.learner.close()

    after = Cluster(folder, config(0, fragment_steps=4))
    after.come("one", "two")
    kept = [(episode.episode, episode.fragment) for episode in brought if episode.fragment > 0]  # the rest died
    answer = after.question("one", kept)
    assert answer.missing.tolist() == [[1, 1], [1, 2], [2, 1]]
    assert answer.safe_before == 1
    for episode in brought[3:]:
        if episode.fragment > 0:
            after.bring(episode)
    for expected in ((1, 0), (2, 0)):
        lease = after.lease("two")
        assert (lease.episode, lease.fragment) == expected
        after.bring(fragment(lease))
    again = after.weights(8)
    for name, tensor in weights.tensors.items():
        assert again.tensors[name].tobytes() == tensor.tobytes()
    lease = after.lease("one")
    assert (lease.episode, lease.fragment, lease.first_step) == (2, 2, progressed.first_step)
    assert lease.progressed.actions.tobytes() == progressed.actions.tobytes()
    after.learner.close()


@pytest.mark.parametrize("field", ["weights_version", "first_step", "steps"])
def test_a_fragment_that_is_not_what_was_leased_is_refused_and_leased_anew(tmp_path, field):
    cluster = Cluster(RunFolder(tmp_path), config(0, fragment_steps=4))
    cluster.come("one")
    cluster.bring(fragment(cluster.lease("one")))
    lease = cluster.lease("one")
    changes = {
        "weights_version": {"weights_version": 0},
        "first_step": {"progressed": lease.progressed.model_copy(update={"first_step": 5})},
        "steps": {"steps": 3},
    }
    cluster.bring(fragment(lease.model_copy(update=changes[field])))
    assert (cluster.learner._rejected, cluster.learner._ledger.version) == (1, 1)
    assert cluster.lease("one").fragment == 1
    cluster.learner.close()


def test_a_checkpoint_asked_for_in_an_episode_is_of_the_last_whole_one(tmp_path):
    cluster = Cluster(RunFolder(tmp_path), config(0, fragment_steps=4))
    cluster.come("one")
    settled = None
    for _ in range(5):
        cluster.bring(fragment(cluster.lease("one")))
        settled = cluster.weights(3) or settled
    assert cluster.learner._ledger.fragment == 2
    newest = cluster.weights(5)
    cluster.learner._save_checkpoint()
    cluster.learner.close()
    tensors, _ = checkpoint.load(tmp_path / "checkpoints" / "00000001.safetensors", "checkpoint")
    assert all(tensors[name].tobytes() == tensor.tobytes() for name, tensor in settled.tensors.items())
    assert any(tensors[name].tobytes() != tensor.tobytes() for name, tensor in newest.tensors.items())


def test_a_snapshot_within_an_episode_goes_on_with_its_next_fragment(tmp_path):
    folder = RunFolder(tmp_path)
    before = Cluster(folder, config(0, fragment_steps=4))
    before.come("one")
    for _ in range(5):
        before.bring(fragment(before.lease("one")))
    before.learner._save_snapshot()
    lease, settled = before.lease("one"), before.learner._settled
    before.bring(fragment(lease))
    weights = before.weights(6)
    before.learner.close()

    after = Cluster(folder, config(0, fragment_steps=4))
    after.come("two")
    again = after.lease("two")
    assert (again.episode, again.fragment, again.steps, again.weights_version) == (1, 2, lease.steps, 5)
    assert again.progressed.actions.tobytes() == lease.progressed.actions.tobytes()
    assert all(after.learner._settled[name].tobytes() == array.tobytes() for name, array in settled.items())
    after.bring(fragment(again))
    for name, tensor in weights.tensors.items():
        assert after.weights(6).tensors[name].tobytes() == tensor.tobytes()
    after.learner.close()
    assert [row.digest for row in after.learner._archive.rows] == [row.digest for row in before.learner._archive.rows]
