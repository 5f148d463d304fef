"""A learner that goes on from a snapshot can still hand out all that its leases name."""

import gc
import os
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_episodes import answer_to, edited

from railctl.common import checkpoint
from railctl.common.board import BoardReader
from railctl.common.bus import Traffic
from railctl.common.config import parse_config
from railctl.common.folder import RunFolder
from railctl.common.inbox import Inbox
from railctl.common.process import Fatal
from railctl.common.rail.normalise import N_FEATURES
from railctl.common.records.acting import LeaseRequest, WeightsRequest
from railctl.common.records.control import Empty, LearnerCommand
from railctl.common.records.rows import EpisodeRow, HistoryRequest, MetricRow
from railctl.common.rows import read_rows
from railctl.common.wire import keys
from railctl.common.wire.keys import Alive
from railctl.services.learner import service
from railctl.services.learner.service import Learner


class Question:
    """A question that remembers its answer."""

    def __init__(self, request):
        self.request = request
        self.answered = self.refused = self.last = None
        self.dropped = False

    def answer(self, record, *, last=True):
        self.answered, self.last = record, last

    def refuse(self, reason):
        self.refused = reason

    def drop(self):
        self.dropped = True


class Wire:
    """The bus of a learner that a test talks to directly; what it says waits in the inbox."""

    refused = 0
    traffic = Traffic()

    def __init__(self):
        self.inbox, self.heard = Inbox(), []
        self.served, self.on_fragment, self.on_alive = {}, None, None

    def into(self, handle):
        return lambda *arguments: self.inbox.put(partial(handle, *arguments))

    def publish(self, _topic, _record):
        pass

    def publisher(self, _topic):
        return self.heard.append

    def serve(self, service, on_question):
        self.served[service] = self.into(on_question)

    def subscribe(self, topic, on_record):
        assert topic is keys.FRAGMENTS
        self.on_fragment = self.into(on_record)

    def watch_alive(self, _key, on_change):
        self.on_alive = self.into(on_change)


class Cluster:
    """A learner and what its actors would say."""

    def __init__(self, folder, config):
        self.wire = Wire()
        stopping = SimpleNamespace(asked=False)
        self.folder = folder
        self.beats_while_reading = 0
        heartbeat = SimpleNamespace(beat=self.on_beat, beat_on=self.on_beat_on)
        context = SimpleNamespace(folder=folder, config=config, bus=self.wire, heartbeat=heartbeat, stopping=stopping)
        self.learner = Learner(context, self.wire.inbox)
        self.learner.open()

    def on_beat(self, _state, report, **_options):
        self.report = report()

    def on_beat_on(self):
        self.beats_while_reading += 1

    def come(self, *incarnations):
        for incarnation in incarnations:
            self.wire.on_alive(Alive("actor", incarnation, incarnation), True)

    def ask(self, service, request):
        question = Question(request)
        self.wire.served[service](question)
        self.learner.turn()
        return question

    def save(self):
        """A snapshot and a checkpoint."""
        assert self.ask(keys.COMMAND_LEARNER, LearnerCommand(verb="checkpoint")).answered.done

    def question(self, incarnation, kept=()):
        units = np.array(kept, np.int64).reshape(-1, 2)
        request = LeaseRequest(actor=incarnation, incarnation=incarnation, serves="any", kept=units)
        return self.ask(keys.LEASE, request).answered

    def lease(self, incarnation):
        answer = self.question(incarnation)
        return None if answer is None else answer.lease

    def weights(self, version):
        return self.ask(keys.PULL_WEIGHTS, WeightsRequest(version=version)).answered

    def bring(self, fragment):
        self.wire.on_fragment(fragment)
        self.learner.turn()

    def rows(self):
        return read_rows(self.folder.episodes_file, EpisodeRow)


def acted(lease, actor="one", number_of_them=3, steps=None):
    """What an actor makes of a lease; an episode that comes in fragments has so many."""
    over = lease.steps is None or lease.fragment == number_of_them - 1
    return answer_to(lease, actor=actor, over=over, steps=steps, n_features=N_FEATURES, n_trains=3)


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
        before.bring(acted(lease))
        handed_out[episode + 1] = before.weights(episode + 1)
    assert len({weights.tensors[name].tobytes() for weights in handed_out.values() for name in weights.tensors}) > 7
    before.save()
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


def free(**changes):
    cluster = {"actors": {"easy": 1}, "snapshot_every_episodes": 5}
    return config("free", **{"max_staleness": 4, "cluster": cluster} | changes)


def test_a_free_run_leases_the_newest_weights_and_says_how_stale_they_were(tmp_path):
    cluster = Cluster(RunFolder(tmp_path), free())
    cluster.come("one", "two")
    slow = cluster.lease("two")
    assert (slow.episode, slow.weights_version) == (0, 0)
    ahead = [cluster.lease("one")]
    for _ in range(3):
        cluster.bring(acted(ahead[-1], "one"))
        ahead.append(cluster.lease("one"))
    cluster.bring(acted(ahead[-1], "one"))
    assert [lease.weights_version for lease in ahead] == [0, 0, 0, 0]
    cluster.bring(acted(slow, "two"))
    lease = cluster.lease("one")
    assert (lease.episode, lease.weights_version) == (5, 5)
    cluster.bring(acted(lease, "one"))
    cluster.learner.close()
    assert [row.staleness for row in cluster.rows()] == [0, 1, 2, 3, 4, 0]
    assert [row.weights_version for row in cluster.rows()] == [0, 0, 0, 0, 0, 5]
    metrics = read_rows(RunFolder(tmp_path).metrics_file, MetricRow)
    assert [row.metrics["staleness"] for row in metrics] == [0, 1, 2, 3, 4, 0]
    assert cluster.report.staleness_last_100 == pytest.approx(10 / 6)


def test_a_free_run_that_goes_on_trains_every_episode_once_and_minds_no_other_curve(tmp_path, caplog):
    folder = RunFolder(tmp_path)
    before = Cluster(folder, free())
    before.come("one", "two")
    for _ in range(7):
        before.bring(acted(before.lease("one")))
    kept = acted(before.lease("one"))  # with version 7, which is lost
    before.learner.close()

    after = Cluster(folder, free())
    after.come("one", "two")
    assert after.question("one", [kept.lease.unit]).missing.tolist() == [[7, 0]]
    after.bring(kept)
    for _ in range(2):
        lease = after.lease("two")
        assert lease.weights_version == lease.episode
        after.bring(acted(edited(lease, weights_version=2), "two"))
    after.learner.close()
    assert [row.episode for row in after.rows()] == list(range(8))
    assert [row.staleness for row in after.rows()[5:]] == [3, 4, 0]
    assert "is not what it was before" not in caplog.text


def test_an_exact_run_whose_curve_comes_out_different_says_so(tmp_path, caplog):
    folder = RunFolder(tmp_path)
    for seen in (0.25, 0.5):
        cluster = Cluster(folder, config(0))
        cluster.come("one")
        lease = cluster.lease("one")
        cluster.bring(answer_to(lease, actor="one", n_features=N_FEATURES, n_trains=3, seen=seen))
        cluster.learner.close()
    assert "episode 0 is not what it was before the restart" in caplog.text


def test_the_log_says_the_first_of_many_refusals_and_then_only_how_many_there_were(tmp_path, caplog):
    cluster = Cluster(RunFolder(tmp_path), config(0))
    cluster.come("one")
    fragment = acted(cluster.lease("one"), actor="two")
    for _ in range(2000):
        cluster.wire.on_fragment(fragment)
    cluster.learner.turn()
    cluster.learner.close()
    said = [message for message in caplog.messages if message.startswith("refused")]
    assert len(said) == 22
    assert said[-1] == "refused episode 0, fragment 0 of two: it is leased to one (the 2000.)"
    assert cluster.learner._desk.refused == 2000


def test_a_free_run_keeps_the_weights_of_its_newest_checkpoint(tmp_path):
    """It would not come to them again, and who looks at its scores would look at those of others."""
    folder = RunFolder(tmp_path)
    cluster = Cluster(folder, free(evaluation={"every_episodes": 3}))
    cluster.come("one")
    for _ in range(4):
        cluster.bring(acted(cluster.lease("one")))
    cluster.learner.close()
    assert [path.stem for path in sorted(folder.snapshots.iterdir())] == ["00000003"]
    assert [path.stem for path in sorted(folder.checkpoints.iterdir())] == ["00000003"]


def test_a_checkpoint_is_listed_as_soon_as_it_is_written(tmp_path):
    cluster = Cluster(RunFolder(tmp_path), config(0))
    assert cluster.ask(keys.LIST_CHECKPOINTS, Empty()).answered.episodes == []
    cluster.save()
    cluster.learner.close()
    assert cluster.ask(keys.LIST_CHECKPOINTS, Empty()).answered.episodes == [0]


def test_fragments_act_with_the_weights_after_the_one_before_and_end_where_updates_fall_due(tmp_path):
    cluster = Cluster(RunFolder(tmp_path), config(0, fragment_steps=4))
    cluster.come("one")
    seen = []
    for _ in range(7):
        lease = cluster.lease("one")
        seen.append((lease.episode, lease.fragment, lease.first_step, lease.steps, lease.weights_version))
        cluster.bring(
            acted(lease, steps=3 if lease.unit == (0, 2) else None)  # it may be over before its lease is
        )
    cluster.learner.close()
    assert seen == [
        (0, 0, 0, 4, 0),
        (0, 1, 4, 4, 1),
        (0, 2, 8, 4, 2),
        (1, 0, 0, 1, 3),  # 11 steps are over: after the next one an update falls due
        (1, 1, 1, 4, 4),
        (1, 2, 5, 4, 5),
        (2, 0, 0, 4, 6),
    ]
    assert [(row.steps, row.decisions, row.weights_version) for row in cluster.rows()] == [(11, 11, 0), (9, 9, 3)]


def test_an_open_episode_comes_again_after_a_restart_kept_or_acted_anew_and_ends_in_the_same_weights(tmp_path):
    folder = RunFolder(tmp_path)
    before = Cluster(folder, config(0, fragment_steps=4))
    before.come("one")
    brought = []
    for _ in range(8):
        brought.append(acted(before.lease("one")))
        before.bring(brought[-1])
        if len(brought) == 3:
            before.save()
    weights = before.weights(8)
    progressed = before.lease("one").progressed
    before.learner.close()

    after = Cluster(folder, config(0, fragment_steps=4))
    after.come("one", "two")
    kept = [fragment.lease.unit for fragment in brought if fragment.lease.fragment > 0]  # the rest died
    answer = after.question("one", kept)
    assert answer.missing.tolist() == [[1, 1], [1, 2], [2, 1]]
    assert answer.safe_before == 1
    for fragment in brought[3:]:
        if fragment.lease.fragment > 0:
            after.bring(fragment)
    for expected in ((1, 0), (2, 0)):
        lease = after.lease("two")
        assert (lease.episode, lease.fragment) == expected
        after.bring(acted(lease, "two"))
    again = after.weights(8)
    for name, tensor in weights.tensors.items():
        assert again.tensors[name].tobytes() == tensor.tobytes()
    lease = after.lease("one")
    assert (lease.episode, lease.fragment, lease.first_step) == (2, 2, progressed.first_step)
    assert lease.progressed.actions.tobytes() == progressed.actions.tobytes()
    after.learner.close()


def test_what_an_earlier_learner_leased_otherwise_is_refused_and_leased_anew(tmp_path):
    folder = RunFolder(tmp_path)
    cluster = Cluster(folder, config(0, fragment_steps=4))
    cluster.come("one")
    cluster.bring(acted(cluster.lease("one")))
    lease = cluster.lease("one")
    cluster.save()
    cluster.learner.close()

    after = Cluster(folder, config(0, fragment_steps=4))
    after.come("one")
    assert after.question("one", [(0, 1)]).missing.tolist() == [[0, 1]]
    after.bring(acted(edited(lease, weights_version=0)))
    assert (after.report.refused, after.report.weights_version) == (1, 1)
    again = after.question("one", [(0, 1)])  # it is not asked for once more
    assert (again.lease.unit, again.lease.weights_version) == ((0, 1), 1)
    after.bring(acted(again.lease))
    assert (after.report.refused, after.report.weights_version) == (1, 2)
    after.learner.close()


def assert_saved(path, weights):
    """The checkpoint holds these weights; returns its own."""
    tensors, _ = checkpoint.load(path, "checkpoint")
    assert all(tensors[name].tobytes() == tensor.tobytes() for name, tensor in weights.items())
    return tensors


def test_a_checkpoint_asked_for_in_an_episode_is_of_the_last_whole_one(tmp_path):
    cluster = Cluster(RunFolder(tmp_path), config(0, fragment_steps=4))
    cluster.come("one")
    settled = None
    for _ in range(5):
        cluster.bring(acted(cluster.lease("one")))
        settled = cluster.weights(3) or settled
    assert cluster.lease("one").fragment == 2
    newest = cluster.weights(5)
    cluster.save()
    cluster.learner.close()
    tensors = assert_saved(tmp_path / "checkpoints" / "00000001.safetensors", settled.tensors)
    assert any(tensors[name].tobytes() != tensor.tobytes() for name, tensor in newest.tensors.items())


def test_a_snapshot_within_an_episode_goes_on_with_its_next_fragment(tmp_path):
    folder = RunFolder(tmp_path)
    before = Cluster(folder, config(0, fragment_steps=4))
    before.come("one")
    for _ in range(5):
        before.bring(acted(before.lease("one")))
    before.save()
    lease, saved = before.lease("one"), tmp_path / "checkpoints" / "00000001.safetensors"
    settled, _ = checkpoint.load(saved, "checkpoint")
    saved.unlink()
    before.bring(acted(lease))
    weights = before.weights(6)
    before.learner.close()

    after = Cluster(folder, config(0, fragment_steps=4))
    after.come("two")
    again = after.lease("two")
    assert (again.episode, again.fragment, again.steps, again.weights_version) == (1, 2, lease.steps, 5)
    assert again.progressed.actions.tobytes() == lease.progressed.actions.tobytes()
    after.save()
    assert_saved(saved, settled)
    after.bring(acted(again, "two"))
    for name, tensor in weights.tensors.items():
        assert after.weights(6).tensors[name].tobytes() == tensor.tobytes()
    after.learner.close()


class Witness(Question):
    """A question that remembers how many rows there were when it was answered."""

    def __init__(self, request, cluster):
        super().__init__(request)
        self.cluster = cluster
        self.rows = None

    def answer(self, record, *, last=True):
        super().answer(record, last=last)
        self.rows = len(self.cluster.rows())


@pytest.mark.parametrize(
    ("service", "request_", "rows"),
    [
        (keys.COMMAND_LEARNER, LearnerCommand(verb="checkpoint"), 1),  # its snapshot counts on the row
        (keys.LEASE, LeaseRequest(actor="one", incarnation="one", serves="any", kept=np.zeros((0, 2), np.int64)), 0),
    ],
)
def test_of_what_is_asked_while_an_episode_ends_only_a_lease_goes_out_before_its_row(
    tmp_path, monkeypatch, service, request_, rows
):
    cluster = Cluster(RunFolder(tmp_path), config(0))
    cluster.come("one")
    fragment, question = acted(cluster.lease("one")), Witness(request_, cluster)
    train = cluster.learner._trainer.train

    def ask_meanwhile(fragment):
        cluster.wire.served[service](question)
        return train(fragment)

    monkeypatch.setattr(cluster.learner._trainer, "train", ask_meanwhile)
    cluster.bring(fragment)
    assert question.answered is not None
    assert question.rows == rows
    assert len(cluster.rows()) == 1
    cluster.learner.close()


def test_a_loss_that_is_not_finite_ends_the_run(tmp_path, monkeypatch):
    cluster = Cluster(RunFolder(tmp_path), config(0))
    cluster.come("one")
    fragment = acted(cluster.lease("one"))

    def diverges(_fragment):
        raise FloatingPointError("the loss is nan: training has diverged, lower dqn.learning_rate")

    monkeypatch.setattr(cluster.learner._trainer, "train", diverges)
    with pytest.raises(Fatal, match=r"^episode 0: the loss is nan: .* lower dqn\.learning_rate$"):
        cluster.bring(fragment)
    cluster.learner.close()


def test_weights_that_are_not_finite_end_the_run_and_nobody_gets_them(tmp_path, monkeypatch):
    cluster = Cluster(RunFolder(tmp_path), config(0))
    cluster.come("one")
    fragment, board = acted(cluster.lease("one")), BoardReader(RunFolder(tmp_path).board_file)
    weights = {name: np.full_like(array, np.inf) for name, array in cluster.learner._trainer.weights().items()}
    monkeypatch.setattr(cluster.learner._trainer, "weights", lambda: weights)
    with pytest.raises(Fatal, match=r"^weights 1 have numbers that are not finite: training has diverged"):
        cluster.bring(fragment)
    assert board.get(0) is not None
    assert board.get(1) is None
    board.close()
    cluster.learner.close()


def test_history_is_read_from_disk_when_somebody_asks(tmp_path, monkeypatch):
    monkeypatch.setattr(service, "HISTORY_CHUNK", 2)
    cluster = Cluster(RunFolder(tmp_path), config(0))
    cluster.come("one")
    for _ in range(5):
        cluster.bring(acted(cluster.lease("one")))
    gc.collect()
    assert not [found for found in gc.get_objects() if type(found) in (EpisodeRow, MetricRow)]
    answers = [cluster.ask(keys.EPISODE_HISTORY, HistoryRequest(first=first)).answered for first in (0, 2, 4, 5)]
    assert [[row.episode for row in answer.rows] for answer in answers] == [[0, 1], [2, 3], [4], []]
    assert {answer.total for answer in answers} == {5}
    cluster.learner.close()


def test_training_waits_for_no_history(tmp_path, monkeypatch):
    """However many ask at once, one of them is answered between two episodes; who has given up by then is not."""
    cluster = Cluster(RunFolder(tmp_path), config(0))
    cluster.come("one")

    def asked():
        question = Question(HistoryRequest(first=0))
        cluster.wire.served[keys.EPISODE_HISTORY](question)
        return question

    questions = [asked(), asked()]
    for answered in (1, 2):
        cluster.learner.turn()
        assert [question.answered for question in questions].count(None) == 2 - answered
    monkeypatch.setattr(service, "HISTORY_PATIENCE_S", -1.0)
    late = asked()
    cluster.learner.turn()
    assert late.answered is None
    assert late.dropped
    cluster.learner.close()


def test_of_a_flood_of_those_who_ask_for_history_only_so_many_wait(tmp_path, monkeypatch):
    monkeypatch.setattr(service, "MOST_ASKED", 2)
    cluster = Cluster(RunFolder(tmp_path), config(0))
    questions = [Question(HistoryRequest(first=0)) for _ in range(4)]
    for question in questions:
        cluster.wire.served[keys.EPISODE_HISTORY](question)
    cluster.learner.turn()
    cluster.learner.turn()
    assert [question.answered is not None for question in questions] == [True, True, False, False]
    assert [question.dropped for question in questions] == [False, False, True, True]
    cluster.learner.close()


def test_the_metrics_of_an_episode_in_which_a_run_stopped_are_those_of_one_undisturbed(tmp_path):
    rows = []
    for name, stops in (("undisturbed", False), ("stopped", True)):
        folder = RunFolder(tmp_path / name)
        folder.path.mkdir()
        cluster = Cluster(folder, config(0, fragment_steps=4))
        for number in range(6):
            if stops and number in (4, 5):
                cluster.save()
                cluster.learner.close()
                cluster = Cluster(folder, config(0, fragment_steps=4))
            cluster.come("one")
            cluster.bring(acted(cluster.lease("one")))
        cluster.learner.close()
        rows.append([told(row.metrics) for row in read_rows(folder.metrics_file, MetricRow)])
    assert rows[0] == rows[1]
    assert [row["fragments"] for row in rows[0]] == [3, 3]


def test_a_learner_says_that_it_lives_while_it_reads_what_it_has(tmp_path):
    """Of millions of episodes, of which its supervisor would think that it hangs."""
    before = Cluster(RunFolder(tmp_path), config(0))
    before.come("one")
    for _ in range(5):
        before.bring(acted(before.lease("one")))
    before.save()
    before.learner.close()
    after = Cluster(RunFolder(tmp_path), config(0))
    after.learner.close()
    times_read = {"episodes": 3, "metrics": 2}
    assert after.beats_while_reading == 5 * sum(times_read.values())


def test_the_metrics_of_what_is_in_a_snapshot_are_on_disk_before_it(tmp_path, monkeypatch):
    folder, synced = RunFolder(tmp_path), []
    cluster = Cluster(folder, config(0))
    cluster.come("one")
    cluster.bring(acted(cluster.lease("one")))
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(Path(f"/proc/self/fd/{number}").readlink()))
    cluster.save()
    cluster.learner.close()
    [snapshot] = [number for number, path in enumerate(synced) if path == folder.snapshots]
    assert folder.metrics_file in synced[:snapshot]


def told(metrics):
    """What is the same whenever it is told."""
    return {name: value for name, value in metrics.items() if not name.endswith("_s") and "message" not in name}
