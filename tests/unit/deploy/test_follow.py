"""Following a run: every row once and in order, whatever the wire loses, and its status without a supervisor."""

import json
import os
from types import SimpleNamespace

import pytest
from made_rows import episode_row

from railctl.common.bus import NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.locks import sole
from railctl.common.records.rows import EpisodeRow, EpisodeRows, EvaluationRow, EvaluationRows
from railctl.common.rows import RowFile
from railctl.common.wire import keys
from railctl.deploy.follow import Rows, outcome_of, rows_from_files, status_from_files, wait_until
from railctl.deploy.launch import save_config
from railctl.deploy.resolve import resolve

CHUNK = 3  # the rows that our learner sends at a time


def episode(number):
    return episode_row(number, normalised_return=-number / 100)


def evaluation(number, level="easy"):
    return EvaluationRow(
        mode="greedy",
        episode=number,
        level=level,
        levels=10,
        normalised_return=-0.25,
        arrived_share=0.75,
        all_arrived_share=0.5,
        mean_steps=41.5,
        weights_digest="0" * 32,
        evaluated_unix_s=1000.0,
        evaluating_s=1.0,
    )


class Wire:
    """A bus at whose other end are a learner and an evaluator with these histories."""

    def __init__(self, episodes=0, evaluations=()):
        self.episodes = [episode(number) for number in range(episodes)]
        self.evaluations = [evaluation(number) for number in evaluations]
        self.away = False
        self._subscribed = {}

    def subscribe(self, topic, on_record):
        self._subscribed[topic] = on_record

    def ask(self, service, request, _timeout_s):
        if self.away:
            raise NoAnswer("away")
        if service is keys.EPISODE_HISTORY:
            return EpisodeRows(rows=self.episodes[request.first :][:CHUNK], total=len(self.episodes))
        return EvaluationRows(rows=self.evaluations[request.first :][:CHUNK], total=len(self.evaluations))

    def train(self, *, lost=False):
        self.episodes.append(episode(len(self.episodes)))
        if not lost:
            self.say(self.episodes[-1])

    def evaluate(self, number):
        self.evaluations.append(evaluation(number))
        self._subscribed[keys.EVALUATION_ROWS](self.evaluations[-1])

    def say(self, row):
        self._subscribed[keys.EPISODE_ROWS](row)


@pytest.fixture
def folder(tmp_path):
    folder = RunFolder(tmp_path)
    save_config(folder, resolve({"episodes": 100}))
    return folder


def write(folder, episodes, evaluations=()):
    for path, kind, rows in (
        (folder.episodes_file, EpisodeRow, [episode(number) for number in range(episodes)]),
        (folder.evaluations_file, EvaluationRow, [evaluation(number) for number in evaluations]),
    ):
        file = RowFile(path, kind)
        for row in rows:
            file.append(row)
        file.close()


def names(rows):
    """Episode 4 as 4, the evaluation after 4 episodes as 'after 4'."""
    return [row.episode if isinstance(row, EpisodeRow) else f"after {row.episode}" for row in rows]


def follow(rows):
    """All that has come by now."""
    found = []
    while not rows._fresh.empty():
        found += rows.next(0)
    return names(found)


def test_history_comes_whole_and_in_order(folder):
    rows = Rows(Wire(7, evaluations=[2, 4]), None)
    assert names(rows.history()) == [0, 1, "after 2", 2, 3, "after 4", 4, 5, 6]


def test_a_history_of_many_evaluations_comes_whole_too(folder):
    rows = Rows(Wire(9, evaluations=range(1, 9)), None)
    assert [row.episode for row in rows.history() if isinstance(row, EvaluationRow)] == list(range(1, 9))


def test_a_history_that_no_memory_would_hold_comes_bit_by_bit(folder):
    wire = Wire(7)
    history = Rows(wire, None).history()
    assert names([next(history)]) == [0]
    wire.away = True
    assert names(history) == list(range(1, CHUNK))  # what came with it; nobody has asked for more


def test_what_comes_later_comes_once(folder):
    wire = Wire(2)
    rows = Rows(wire, None)
    assert names(rows.history()) == [0, 1]
    assert list(rows.next(0)) == []
    wire.train()
    wire.train()
    wire.evaluate(4)
    assert follow(rows) == [2, 3, "after 4"]


def test_what_came_between_subscribing_and_asking_for_history_comes_once(folder):
    wire = Wire(2)
    rows = Rows(wire, None)
    wire.train()
    assert names(rows.history()) == [0, 1, 2]
    assert follow(rows) == []
    wire.train()
    assert follow(rows) == [3]


def test_rows_that_got_lost_are_fetched_with_the_next_one(folder):
    wire = Wire(1)
    rows = Rows(wire, None)
    list(rows.history())
    for lost in (True, True, True, True, True, False):
        wire.train(lost=lost)
    assert follow(rows) == [1, 2, 3, 4, 5, 6]
    wire.train()
    assert follow(rows) == [7]


def test_rows_of_a_learner_that_goes_back_to_its_snapshot_come_once(folder):
    wire = Wire(5)
    rows = Rows(wire, None)
    list(rows.history())
    for number in (3, 4):
        wire.say(episode(number))
    assert follow(rows) == []
    wire.train()
    assert follow(rows) == [5]


def test_while_the_learner_is_away_nothing_is_skipped(folder):
    wire = Wire(3)
    wire.away = True
    rows = Rows(wire, None)
    assert list(rows.history()) == []
    wire.away = False
    wire.train()
    assert follow(rows) == [0, 1, 2, 3]


def test_files_on_this_machine_have_the_history_and_nobody_is_asked(folder):
    wire = Wire()
    wire.away = True
    rows = Rows(wire, folder)
    write(folder, 3, evaluations=[2])
    assert names(rows.history()) == names(rows_from_files(folder)) == [0, 1, "after 2", 2]
    wire.say(episode(2))
    wire.say(episode(3))
    assert follow(rows) == [3]
    file = RowFile(folder.episodes_file, EpisodeRow)
    for number in (3, 4, 5):
        file.append(episode(number))
    file.close()
    wire.say(episode(5))  # 4 got lost
    assert follow(rows) == [4, 5]


@pytest.mark.parametrize(
    ("content", "outcome"),
    [
        (None, ("stopped", "its supervisor ended without a word: railctl up resumes the run")),
        ("{", ("stopped", "its supervisor ended without a word: railctl up resumes the run")),
        (json.dumps({"outcome": "finished", "reason": ""}), ("finished", "")),
        (json.dumps({"outcome": "failed", "reason": "no disk"}), ("failed", "no disk")),
    ],
)
def test_how_a_run_ended(folder, content, outcome):
    if content is not None:
        folder.outcome_file.write_text(content)
    assert outcome_of(folder) == outcome


def test_a_full_disk_may_have_kept_the_word_back(folder, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _path: SimpleNamespace(free=0))
    assert outcome_of(folder) == ("stopped", "the disk is full: make room, then railctl up resumes the run")


def test_the_status_of_a_run_that_is_not_running_comes_from_its_files(folder):
    folder.outcome_file.write_text(json.dumps({"outcome": "failed", "reason": "no disk"}))
    write(folder, 6, evaluations=[2, 4])
    for kept, number in (
        (folder.snapshots, 3),
        (folder.snapshots, 5),
        (folder.checkpoints, 2),
        (folder.checkpoints, 4),
    ):
        kept.mkdir(exist_ok=True)
        (kept / f"{number:08d}.safetensors").touch()
    status = status_from_files(folder)
    assert (status.run, status.state, status.episodes, status.algorithm) == (folder.path.name, "failed", 100, "dddqn")
    assert (status.problems, status.processes, status.supervisor_pid) == (["no disk"], [], None)
    progress = status.progress
    assert (progress.done, progress.snapshot, progress.evaluations, progress.evaluations_due) == (6, 5, 2, 2)
    assert progress.return_last_100 == pytest.approx(-0.025)


def test_a_long_reason_is_cut_and_the_status_told(folder):
    folder.outcome_file.write_text(json.dumps({"outcome": "failed", "reason": "no disk " * 1000}))
    [problem] = status_from_files(folder).problems
    assert len(problem) == 4000
    assert problem.startswith("no disk no disk")


def test_the_status_of_a_run_that_never_started(folder):
    status = status_from_files(folder)
    assert (status.state, status.progress.done, status.progress.return_last_100) == ("stopped", 0, None)


def test_the_status_of_a_run_that_lost_its_supervisor(folder):
    with sole(folder, "router"), sole(folder, "actor-easy-0"), sole(folder, "actor-any-1"):
        status = status_from_files(folder)
    assert status.state == "unsupervised"
    assert [(process.process, process.role, process.serves) for process in status.processes] == [
        ("actor-any-1", "actor", "any"),
        ("actor-easy-0", "actor", "easy"),
        ("router", "router", None),
    ]


def test_a_supervisor_that_does_not_answer_is_not_said_to_have_ended(folder):
    with sole(folder, "supervisor"):
        status = status_from_files(folder)
    assert (status.state, status.supervisor_pid) == ("unsupervised", os.getpid())
    assert status.problems == [f"its supervisor, process {os.getpid()}, does not answer: it begins or hangs; ask again"]


@pytest.mark.parametrize("level", ["rush-hour", "a-b-c", "2024-12-01", "any", "x" * 40])
def test_names_of_levels_may_have_hyphens(folder, level):
    with sole(folder, f"actor-{level}-12"):
        [process] = status_from_files(folder).processes
    assert (process.process, process.role, process.serves) == (f"actor-{level}-12", "actor", level)


def test_waiting_ends_when_it_comes_true_or_when_patience_ends():
    looks = iter([False, True])
    assert wait_until(lambda: next(looks), 10.0)
    assert not wait_until(lambda: False, 0.0)
