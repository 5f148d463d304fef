"""What every process shares: it stops when told, beats once a second, and takes its place alone."""

import json
import logging
import os
import shutil
import signal
import subprocess
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue

import pytest
import yaml

from railctl.common import process
from railctl.common.bus import NoAnswer, open_bus, open_router
from railctl.common.compile_signs import COMPILING, around_compiling, compiling
from railctl.common.config import parse_config
from railctl.common.folder import RunFolder
from railctl.common.interpreter import PYTHON
from railctl.common.locks import RunsAlreadyError, holder, sole
from railctl.common.private import private_endpoint, remove_endpoint
from railctl.common.process import (
    EXIT_FATAL,
    EXIT_RUNS_ALREADY,
    STARTING,
    Fatal,
    HeartbeatPublisher,
    Stopping,
    run_service,
    service_context,
)
from railctl.common.records.heartbeats import ActorReport
from railctl.common.strict import ConfigError
from railctl.common.wire import keys
from railctl.common.wire.keys import Alive

PATIENCE_S = 10.0
CONFIG = parse_config(
    {
        "algorithm": "dddqn",
        "mix": {"easy": 1.0},
        "episodes": 2,
        "network": {},
        "dqn": {"learning_rate": 0.001, "batch_size": 8, "learn_every_steps": 4},
        "replay": {"capacity": 100},
        "rule": "dqn",
        "cluster": {"actors": {"easy": 1}},
    }
)

WAITER = """
import sys
from railctl.common.process import Stopping
stopping = Stopping()
print("waits", flush=True)
stopping.wait(600)
print("asked" if stopping.asked else "nobody asked", flush=True)
stopping.wait(600)
print("ends", flush=True)
"""


@pytest.fixture(autouse=True)
def umask():
    """That of whoever runs the tests: a service makes files that nobody else reads."""
    before = os.umask(0)
    os.umask(before)
    yield
    os.umask(before)


@pytest.fixture
def handlers():
    """The signal handlers, as they were."""
    numbers = (signal.SIGTERM, signal.SIGINT)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_wait_ends_when_somebody_asks_to_stop(number):
    with subprocess.Popen([*PYTHON, "-c", WAITER], stdout=subprocess.PIPE, text=True) as child:
        try:
            assert child.stdout.readline() == "waits\n"
            child.send_signal(number)
            assert child.communicate(timeout=PATIENCE_S)[0] == "asked\nends\n"
            assert child.returncode == 0
        finally:
            child.kill()


FULL = Path("/dev/full")


def test_a_wait_that_nobody_ends_lasts_its_time(handlers, monkeypatch):
    clock = Clock()
    monkeypatch.setattr(process, "time", clock)
    stopping = Stopping()
    stopping.wait(1.0)
    assert clock.now == pytest.approx(1.0)
    assert not stopping.asked


class Clock:
    """A clock that moves when somebody sleeps."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        assert seconds <= process.STRETCH_S
        self.now += seconds


class Wire:
    """Keeps what is published."""

    def __init__(self):
        self.published = []

    def publish(self, topic, record):
        assert topic is keys.HEARTBEATS
        self.published.append(record)


@pytest.fixture
def lock(tmp_path):
    path = tmp_path / "processes" / "actor-easy-0"
    path.parent.mkdir()
    path.touch()
    return path


def test_a_heart_beats_at_most_once_a_second_unless_it_must(monkeypatch, lock):
    clock, wire = Clock(), Wire()
    clock.now = 100.0
    monkeypatch.setattr(process, "time", clock)
    heartbeat = HeartbeatPublisher(wire, lock, "actor")
    report = ActorReport(acted=3, kept=1)
    heartbeat.beat("starting")
    heartbeat.beat("training", lambda: pytest.fail("counted for nothing"))
    clock.now += 0.99
    heartbeat.beat("training")
    assert len(wire.published) == 1
    clock.now += 0.01
    heartbeat.beat("training", lambda: report)
    heartbeat.beat("finished", now=True)
    clock.now += 0.5
    heartbeat.beat("finished")
    assert [(beat.state, beat.report) for beat in wire.published] == [
        ("starting", None),
        ("training", report),
        ("finished", None),
    ]
    assert {(beat.process, beat.role, beat.pid) for beat in wire.published} == {("actor-easy-0", "actor", os.getpid())}


def test_a_heart_stops_with_the_folder_of_its_run(lock, tmp_path):
    published = Published()
    heartbeat = HeartbeatPublisher(published, lock, "actor")
    heartbeat.beat("training")
    shutil.rmtree(lock.parent)
    with pytest.raises(Fatal, match=f"{tmp_path} is gone, and so actor-easy-0 ends"):
        heartbeat.beat("training", now=True)
    assert published.qsize() == 1


class Published(SimpleQueue):
    """Hands on what is published to who waits for it."""

    def publish(self, _topic, record):
        self.put(record)


def test_a_heart_beats_while_its_process_compiles(monkeypatch, lock):
    monkeypatch.setattr(process, "HEARTBEAT_EVERY_S", 0.01)
    published, report = Published(), ActorReport(acted=3, kept=1)
    heartbeat = HeartbeatPublisher(published, lock, "actor")
    with around_compiling(heartbeat.while_compiling):
        heartbeat.beat("acting", lambda: report, now=True)
        with compiling("outer"), compiling("inner"):
            beats = [published.get(timeout=PATIENCE_S) for _ in range(4)]
        compiled = published.qsize()
    assert [(beat.state, beat.report) for beat in beats] == [("acting", report), *[(COMPILING, report)] * 3]
    assert not any("compiling" in thread.name for thread in threading.enumerate())
    assert published.qsize() == compiled
    with compiling("another"):
        assert not any("compiling" in thread.name for thread in threading.enumerate())  # nobody asked for it any more


def test_who_is_at_one_thing_for_long_says_the_same_again_once_a_second(monkeypatch, lock):
    published, report = Published(), ActorReport(acted=3, kept=1)
    heartbeat = HeartbeatPublisher(published, lock, "actor")
    heartbeat.beat_on()
    heartbeat.beat_on()
    monkeypatch.setattr(process, "HEARTBEAT_EVERY_S", 0.0)
    heartbeat.beat("acting", lambda: report, now=True)
    heartbeat.beat_on()
    beats = [published.get(timeout=PATIENCE_S) for _ in range(3)]
    assert published.empty()
    assert [(beat.state, beat.report) for beat in beats] == [(STARTING, None), *[("acting", report)] * 2]


def test_a_heart_stops_when_compiling_hangs(monkeypatch, lock):
    monkeypatch.setattr(process, "COMPILE_PATIENCE_S", 0.0)
    published = Published()
    with HeartbeatPublisher(published, lock, "actor").while_compiling("endless"):
        pass
    assert published.empty()


@pytest.mark.parametrize(
    ("error", "code", "level"),
    [
        (Fatal("no more"), EXIT_FATAL, logging.ERROR),
        (ConfigError("no more"), EXIT_FATAL, logging.ERROR),
        (RunsAlreadyError("no more"), EXIT_RUNS_ALREADY, logging.WARNING),
    ],
)
def test_what_a_restart_cannot_mend_ends_with_its_own_code_and_one_line(error, code, level, caplog):
    def main():
        raise error

    with pytest.raises(SystemExit) as caught:
        run_service(main)
    assert caught.value.code == code
    assert [(record.levelno, record.getMessage()) for record in caplog.records] == [(level, "no more")]
    assert caplog.records[0].exc_info is None


def test_exit_codes_differ_from_each_other_and_from_those_of_python():
    assert len({EXIT_FATAL, EXIT_RUNS_ALREADY, 0, 1, 2}) == 5


def test_other_errors_are_not_hidden():
    def main():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_service(main)


LEAVER = """
import atexit
from railctl.common.process import run_service
atexit.register(print, "taken apart")
run_service(lambda: print("done"))
print("went on")
"""


def test_a_service_that_ends_well_leaves_at_once():
    left = subprocess.run([*PYTHON, "-c", LEAVER], capture_output=True, text=True, check=True)
    assert left.stdout == "done\n"


@pytest.fixture
def run(tmp_path):
    """A run whose router listens."""
    folder = RunFolder(tmp_path)
    endpoint = private_endpoint()
    folder.config_file.write_text(yaml.safe_dump(CONFIG.plain()))
    folder.cluster_file.write_text(json.dumps({"endpoint": endpoint, "namespace": "railctl/test"}))
    with open_router(endpoint):
        yield folder
    remove_endpoint(endpoint)


def test_a_place_has_a_token_a_heart_and_a_name_of_its_own(run, handlers):
    changes, beats = SimpleQueue(), SimpleQueue()
    with open_bus(*run.endpoint_and_namespace(), PATIENCE_S) as watcher:
        watcher.watch_alive(keys.ALL_ALIVE, lambda alive, there: changes.put((alive, there)))
        watcher.subscribe(keys.HEARTBEATS, beats.put)
        with service_context(run, "actor-easy-0", "actor") as place:
            alive = Alive("actor", "actor-easy-0", place.incarnation)
            assert changes.get(timeout=PATIENCE_S) == (alive, True)
            assert (place.config, place.name, place.folder) == (CONFIG, "actor-easy-0", run)
            assert holder(run, "actor-easy-0") == os.getpid()
            assert not place.stopping.asked
            os.kill(os.getpid(), signal.SIGTERM)
            place.stopping.wait(PATIENCE_S)
            assert place.stopping.asked
            place.heartbeat.beat("acting", now=True)
            while beats.get(timeout=PATIENCE_S).state != "acting":
                pass  # "starting" comes first, or came too early to be heard
        assert changes.get(timeout=PATIENCE_S) == (alive, False)
        assert holder(run, "actor-easy-0") is None
        with service_context(run, "actor-easy-0", "actor") as again:
            assert again.incarnation != place.incarnation


def test_a_place_that_is_taken_is_not_taken_twice(run, handlers, monkeypatch):
    monkeypatch.setattr("railctl.common.locks.PATIENCE_S", 0.05)
    with (
        sole(run, "learner"),
        pytest.raises(RunsAlreadyError, match=r"learner of .* runs already"),
        service_context(run, "learner", "learner"),
    ):
        pass


def test_a_full_disk_is_fatal_and_other_troubles_may_pass(run, handlers):
    line = rf"^{run.path}: No space left on device: make room, then railctl up --name {run.path.name} goes on$"
    with (
        pytest.raises(Fatal, match=line),
        service_context(run, "learner", "learner"),
        Path("/dev/full").open("w") as full,
    ):
        full.write("a row")
    with pytest.raises(IsADirectoryError), service_context(run, "learner", "learner"):
        run.path.write_text("a row")


def test_a_place_needs_a_configuration_and_a_cluster(tmp_path, handlers):
    folder = RunFolder(tmp_path)
    with (
        pytest.raises(ConfigError, match=r"config\.yaml cannot be read"),
        service_context(folder, "learner", "learner"),
    ):
        pass
    folder.config_file.write_text(yaml.safe_dump(CONFIG.plain()))
    with (
        pytest.raises(NoAnswer, match="has no cluster: start one with railctl up"),
        service_context(folder, "learner", "learner"),
    ):
        pass
    assert holder(folder, "learner") is None


def test_an_actor_on_another_machine_beats_where_only_the_status_believes_it(run, handlers, monkeypatch):
    watched = []
    monkeypatch.setattr(process, "end_with_parent", watched.append)
    cluster = json.loads(run.cluster_file.read_text())
    run.cluster_file.write_text(
        json.dumps(cluster | {"keys": "keys"})
    )  # which a socket of this machine does not ask for
    beats = {topic.key: SimpleQueue() for topic in (keys.HEARTBEATS, keys.FAR_HEARTBEATS)}
    with (
        pytest.raises(Fatal, match="actor-node7-easy-0: whoever started it is gone"),
        service_context(run, "actor-node7-easy-0", "actor"),
    ):
        pass
    watched.clear()
    monkeypatch.setattr(os, "getppid", os.getpid)
    with sole(run, "supervisor"), open_bus(*run.endpoint_and_namespace(), PATIENCE_S) as watcher:
        for topic in (keys.HEARTBEATS, keys.FAR_HEARTBEATS):
            watcher.subscribe(topic, beats[topic.key].put)
        with service_context(run, "actor-node7-easy-0", "actor") as place:
            until_heard(place, beats["heartbeats/far"])
    assert beats["heartbeats"].empty()
    assert watched == [signal.SIGTERM]  # nobody else on its machine would end it


def test_who_is_asked_to_stop_while_there_is_no_router_ends(run, handlers, monkeypatch):
    tries = []

    @contextmanager
    def nobody(*_arguments):
        tries.append(len(tries))
        if len(tries) == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        raise NoAnswer("no router")
        yield

    monkeypatch.setattr(process, "open_bus", nobody)
    with pytest.raises(SystemExit) as ended, service_context(run, "actor-easy-0", "actor"):
        pass
    assert (tries, ended.value.code) == ([0, 1], None)


def until_heard(place, beats):
    """Its first heartbeat may come before anybody is known to listen."""
    deadline = time.monotonic() + PATIENCE_S
    while beats.empty():
        place.heartbeat.beat("waiting for work", now=True)
        assert time.monotonic() < deadline


PARENT = """
import subprocess, sys
subprocess.Popen(sys.argv[1:])
sys.stdin.read()
"""
CHILD = """
import signal
from railctl.common.parent import end_with_parent
end_with_parent(signal.SIGTERM)
print("ready", flush=True)
signal.pause()
"""


def test_who_ends_with_its_parent_ends_however_that_goes():
    command = [*PYTHON, "-c", PARENT, *PYTHON, "-c", CHILD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout.readline() == "ready\n"
        parent.kill()
        assert parent.stdout.read() == ""  # which the child holds open as long as it lives
