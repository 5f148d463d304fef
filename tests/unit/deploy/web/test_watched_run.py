"""A run that is watched: from its files, over its streams, and from one to the other."""

import json
import threading
from contextlib import contextmanager

import pytest
from made_rows import episode_row, evaluation_row

from railctl.common.bus import NoAnswer
from railctl.common.records.control import Status
from railctl.common.records.rows import EventRow, MetricRow
from railctl.common.rows import RowFile
from railctl.common.wire import keys
from railctl.deploy.follow import status_from_files
from railctl.deploy.web import watched_run
from railctl.deploy.web.watched_run import WatchedRun


def part(watched, name):
    return json.loads(watched.parts[name].body)


def look_once(watched):
    watched.pause = lambda _seconds: True
    watched.look()


def test_a_finished_run_is_shown_from_its_files(make):
    folder = make("one", [-0.5] * 20, [evaluation_row(10)])
    (folder.checkpoints / "00000010.safetensors").touch()
    (folder.checkpoints / "mine.safetensors").touch()  # a user may keep others
    events = RowFile(folder.events_file, EventRow)
    events.append(EventRow(time="2026-01-01T00:00:00.000Z", kind="finished", process=None, text="finished"))
    events.close()
    metrics = RowFile(folder.metrics_file, MetricRow)
    metrics.append(MetricRow(episode=0, metrics={"loss": 0.5}))
    metrics.close()
    watched = WatchedRun("one", folder)
    look_once(watched)
    run = part(watched, "run")
    assert (run["source"], run["view"]["state"], run["view"]["progress"]["done"]) == ("files", "finished", 20)
    assert run["checkpoints"] == [10]
    assert part(watched, "evaluations")["evaluations"][0]["return"] == -0.25
    assert [event["text"] for event in run["events"]] == ["finished"]
    assert part(watched, "curves")["measures"]["return"]["easy"]["points"][-1][1] == -0.5
    assert part(watched, "metrics")["curves"] == {"loss": [[1, 0.5]]}


def test_nothing_is_news_as_long_as_files_are_the_same(make):
    watched = WatchedRun("one", make("one", [-0.5] * 20))
    look_once(watched)
    before = watched.parts
    look_once(watched)
    assert watched.parts == before


def test_rows_that_come_to_a_file_are_news(make):
    folder = make("one", [-0.5] * 20)
    watched = WatchedRun("one", folder)
    look_once(watched)
    with folder.episodes_file.open("a") as file:
        file.write(episode_row(20).model_dump_json(by_alias=True) + "\n")
    look_once(watched)
    assert part(watched, "run")["view"]["progress"]["done"] == 21
    assert watched.parts["curves"].version == 2


@pytest.mark.parametrize("damage", ["episodes.jsonl", "config.yaml"])
def test_what_is_damaged_is_said(make, damage):
    folder = make("one", [-0.5] * 20)
    (folder.path / damage).write_text("nonsense\n")
    watched = WatchedRun("one", folder)
    look_once(watched)
    assert damage in part(watched, "run")["wrong"]


def test_what_nobody_foresaw_is_said_and_looked_at_again(make, monkeypatch):
    watched = WatchedRun("one", make("one"))
    looks = []

    def look():
        looks.append(1)
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(watched, "look", look)
    monkeypatch.setattr("railctl.deploy.web.looker.AGAIN_S", 0.01)
    watched.start()
    Waiting(watched).until("run", lambda run: "ZeroDivisionError: division by zero" in run["wrong"] and len(looks) > 1)
    watched.end()
    watched.join(10.0)


class Cluster:
    """A run's bus, with a supervisor that may be silent."""

    def __init__(self, folder):
        self.folder = folder
        self.silent = self.gone = False
        self.on_row = {}

    def subscribe(self, topic, on_record):
        self.on_row[topic] = on_record

    def ask(self, _service, _request, _timeout_s):
        if self.silent or self.gone:
            raise NoAnswer("silent")
        files = status_from_files(self.folder)
        return Status(**files.model_dump() | {"state": "running", "supervisor_pid": 1})


@pytest.fixture
def cluster(make, monkeypatch):
    folder = make("one", [-0.5] * 3, outcome=None)
    cluster = Cluster(folder)

    @contextmanager
    def reach(_folder):
        if cluster.gone:
            raise NoAnswer("gone")
        yield cluster

    monkeypatch.setattr(watched_run, "reach", reach)
    monkeypatch.setattr(watched_run, "living", lambda _folder: {} if cluster.gone else {"learner": 1})
    monkeypatch.setattr(watched_run, "STATUS_EVERY_S", 0.0)
    monkeypatch.setattr(watched_run, "CURVES_EVERY_S", 0.0)
    monkeypatch.setattr(watched_run, "FILES_EVERY_S", 0.01)
    monkeypatch.setattr(watched_run, "ROWS_S", 0.01)
    return cluster


class Waiting:
    """Waits until a watched run shows something."""

    def __init__(self, watched):
        self.watched = watched
        self._news = threading.Event()
        watched.listeners.wake = self._news.set

    def until(self, name, is_there):
        for _ in range(500):
            if name in self.watched.parts and is_there(part(self.watched, name)):
                return
            self._news.wait(0.05)
            self._news.clear()
        pytest.fail(f"{name} is {self.watched.parts.get(name)}")


@pytest.fixture
def watched(cluster):
    watched = WatchedRun("one", cluster.folder)
    waiting = Waiting(watched)
    watched.start()
    yield waiting
    watched.end()
    watched.join(5.0)


def last_episode(curves):
    return curves["measures"]["return"]["easy"]["dots"][-1][0]


def test_a_running_run_is_shown_live(cluster, watched):
    watched.until("run", lambda run: run["source"] == "live")
    watched.until("curves", lambda curves: last_episode(curves) == 3)
    cluster.on_row[keys.EPISODE_ROWS](episode_row(3))
    watched.until("curves", lambda curves: last_episode(curves) == 4)


def test_a_supervisor_that_does_not_answer_is_said_with_the_time(cluster, watched):
    watched.until("run", lambda run: run["source"] == "live")
    cluster.silent = True
    watched.until("run", lambda run: run["source"] == "silent" and run["silent_since_unix_s"] > 0)
    cluster.silent = False
    watched.until("run", lambda run: run["source"] == "live" and run["silent_since_unix_s"] is None)


def test_a_run_that_stops_and_starts_again_is_followed(cluster, watched):
    watched.until("run", lambda run: run["source"] == "live")
    cluster.gone = True
    watched.until("run", lambda run: run["source"] == "files")
    watched.until("curves", lambda curves: len(curves["measures"]["return"]["easy"]["dots"]) == 3)
    with cluster.folder.episodes_file.open("a") as file:
        file.write(episode_row(3).model_dump_json(by_alias=True) + "\n")
    cluster.gone = False
    watched.until("run", lambda run: run["source"] == "live")
    watched.until("curves", lambda curves: last_episode(curves) == 4)
