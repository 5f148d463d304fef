"""Joining a run from another machine: the folder, the end, and what is refused. That it acts is a system test."""

import json
import os
import signal
import socket
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from command_line import complaint

from railctl.common.bus import NoAnswer, open_bus, open_router
from railctl.common.folder import RunFolder
from railctl.common.levels.distributions import LevelFiles
from railctl.common.levels.own import own_copy
from railctl.common.private import private_endpoint, remove_endpoint
from railctl.common.process import Stopping
from railctl.common.records.heartbeats import Heartbeat
from railctl.common.records.joining import LevelPart, RunIntroduction
from railctl.common.sessions import Door
from railctl.common.task import FAILED, WRONG_USAGE
from railctl.common.tls import Credentials
from railctl.common.wire import keys
from railctl.deploy import join
from railctl.deploy.certificates import create
from railctl.deploy.join import Joiner, host_for
from railctl.deploy.plan import actors
from railctl.deploy.resolve import resolve

NAMESPACE = "railctl/0123456789ab"
PATIENCE_S = 10.0
FINISHED = Heartbeat(process="learner", role="learner", pid=7, state="finished", report=None)
CONFIG = yaml.safe_dump(resolve({"episodes": 10}).plain())


@pytest.fixture
def handlers():
    """The signal handlers, as they were."""
    numbers = (signal.SIGTERM, signal.SIGINT, signal.SIGCHLD)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.fixture
def made(tmp_path):
    create(tmp_path / "keys", [])
    return tmp_path / "keys"


@pytest.fixture
def address():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"tls/127.0.0.1:{free.getsockname()[1]}"


@pytest.fixture
def near(made, address):
    """The run's own machine."""
    endpoint = private_endpoint()
    with ExitStack() as stack:
        stack.callback(remove_endpoint, endpoint)
        stack.enter_context(open_router(endpoint, Door(address, NAMESPACE, Credentials(made, "host"))))
        yield stack.enter_context(open_bus(endpoint, NAMESPACE, PATIENCE_S))


@pytest.fixture
def folder(tmp_path, made, address):
    """What a machine that joins has of a run."""
    folder = RunFolder(tmp_path / "run")
    folder.logs.mkdir(parents=True)
    folder.processes.mkdir()
    folder.config_file.write_text(CONFIG)
    folder.cluster_file.write_text(json.dumps({"endpoint": address, "namespace": NAMESPACE, "keys": str(made)}))
    return folder


def introduce(near, namespace=NAMESPACE, config=CONFIG):
    run = RunIntroduction(name="one", namespace=namespace, config=config)
    near.serve(keys.RUN, lambda question: question.answer(run))


def left_behind():
    return list(Path(tempfile.gettempdir()).glob("railctl-join-*"))


# The end


def test_who_has_joined_leaves_when_all_is_trained(near, folder, handlers):
    introduce(near)
    over = threading.Event()

    def beat():
        while not over.wait(0.05):
            near.publish(keys.HEARTBEATS, FINISHED)

    learner = threading.Thread(target=beat)
    learner.start()
    try:
        assert Joiner(folder, []).run(Stopping()).outcome == "finished"
    finally:
        over.set()
        learner.join()


def test_who_has_joined_leaves_when_another_run_has_the_place(near, folder, handlers):
    introduce(near, "railctl/ba9876543210")
    joiner = Joiner(folder, [])
    assert joiner.run(Stopping()).outcome == "stopped"
    assert joiner.other == "one"


def test_who_has_joined_asks_again_when_the_run_is_silent_though_its_link_holds(near, folder, handlers, monkeypatch):
    """As that to a relay does."""
    monkeypatch.setattr(join, "SILENT_S", 0.1)
    monkeypatch.setattr(join, "ASK_EVERY_S", 0.1)
    runs = [RunIntroduction(name=name, namespace=NAMESPACE, config=CONFIG) for name in ("ours", "ours still")]
    runs.append(RunIntroduction(name="another", namespace="railctl/ba9876543210", config=CONFIG))
    near.serve(keys.RUN, lambda question: question.answer(runs.pop(0)))
    joiner = Joiner(folder, [])
    assert joiner.run(Stopping()).outcome == "stopped"
    assert joiner.other == "another"
    assert not runs


def test_who_has_joined_leaves_when_asked_to_though_nobody_is_there(folder, handlers, monkeypatch):
    monkeypatch.setattr(join, "CONNECT_TIMEOUT_S", 0.05)
    stopping = Stopping()
    stopping.asked = True
    assert Joiner(folder, []).run(stopping).outcome == "stopped"


@pytest.mark.parametrize(
    "beat", [FINISHED.model_copy(update={"role": "actor"}), FINISHED.model_copy(update={"state": "training"})]
)
def test_other_heartbeats_of_the_run_end_nothing(folder, handlers, beat):
    joiner = Joiner(folder, [])
    joiner._on_beat_of_the_run(beat)
    assert joiner._quit is None
    joiner._on_beat_of_the_run(FINISHED)
    assert joiner._quit is not None
    joiner._events.close()


# Names


@pytest.mark.parametrize(
    ("machine", "name"),
    [("node7", "node7"), ("node7.example.org", "node7"), ("no_de", "no_de"), ("büro", "b-ro"), ("", "host")],
)
def test_actors_bear_the_name_of_their_machine_and_of_who_joined_there(monkeypatch, machine, name):
    monkeypatch.setattr(socket, "gethostname", lambda: machine)
    assert host_for({"easy": 1}) == f"{name}-{os.getpid()}"


def test_the_name_of_an_actor_is_one_however_long_those_of_machine_and_level_are(monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "rack-17-node-with-a-long-name-" * 3)
    monkeypatch.setattr(os, "getpid", lambda: 2**22)  # the greatest that Linux has
    counts = {"x" * 40: 256}
    for spec in actors(counts, host_for(counts)):
        Heartbeat(process=spec.name, role="actor", pid=1, state="starting", report=None)


# What a run brings


def test_level_files_come_from_the_run_in_parts_and_nothing_else_is_asked_for(tmp_path):
    asked = []

    class Bus:
        def ask(self, service, request, _timeout_s):
            asked.append((service, request.level, request.first))
            return LevelPart(content=b"levels"[request.first :][:4], total=6)

    levels = {"mine": LevelFiles(files=("a.npz",)), "easy": resolve({}).world.levels["easy"]}
    folder = RunFolder(tmp_path)
    join._pull_levels(folder, SimpleNamespace(world=SimpleNamespace(levels=levels)), Bus())
    assert asked == [(keys.PULL_LEVELS, "mine", 0), (keys.PULL_LEVELS, "mine", 4)]
    assert own_copy(tmp_path, "mine").read_bytes() == b"levels"


def test_level_files_that_shrink_meanwhile_are_waited_for_no_longer(tmp_path):
    class Bus:
        def ask(self, _service, request, _timeout_s):
            return LevelPart(content=b"leve"[request.first :], total=6)

    levels = {"mine": LevelFiles(files=("a.npz",))}
    join._pull_levels(RunFolder(tmp_path), SimpleNamespace(world=SimpleNamespace(levels=levels)), Bus())
    assert own_copy(tmp_path, "mine").read_bytes() == b"leve"  # which its digest tells


# railctl join


def join_by_hand(code, address, made, levels="easy=1"):
    before = left_behind()
    text = complaint(code, "join", address, "--keys", made, "--actors", levels)
    assert left_behind() == before
    return text.removeprefix("railctl: ")


def test_a_level_that_the_run_has_not_is_refused(near, address, made, handlers):
    introduce(near)
    assert join_by_hand(WRONG_USAGE, address, made, "hard=1") == "--actors: run one has no level hard: known are easy"


def test_a_run_of_another_version_is_named(near, address, made, handlers):
    introduce(near, config=CONFIG + "xyzzy: 1\n")
    text = join_by_hand(FAILED, address, made)
    assert text.startswith("run one is not one of this version: ")
    assert "xyzzy" in text


def test_what_is_wrong_is_said_before_anybody_is_asked(made):
    assert join_by_hand(WRONG_USAGE, "node7:7447", made).startswith("'node7:7447' is not tls/HOST:PORT: ")
    assert join_by_hand(WRONG_USAGE, "tls/node7:7447", made / "none").startswith(f"{made}/none/ca.pem cannot be read: ")
    assert join_by_hand(WRONG_USAGE, "tls/node7:7447", made, "easy=0") == "--actors easy=0: give at least one"


def test_nobody_at_the_address_is_a_failure(address, made, handlers):
    assert join_by_hand(FAILED, address, made).startswith(f"{address}: Connection refused: ")


def test_patience_ends(address, made, monkeypatch):
    looks = []
    monkeypatch.setattr(join.time, "sleep", looks.append)
    monkeypatch.setattr(join.time, "monotonic", lambda: 7.0 + len(looks))
    with pytest.raises(NoAnswer, match="Connection refused"):
        join._wait_for_run(address, Credentials(made, "actor"), 3.0, [])
    assert len(looks) == 3


def test_a_signal_that_was_lost_ends_the_wait(address, made, monkeypatch):
    came = []
    monkeypatch.setattr(join.time, "sleep", lambda _s: came.append(KeyboardInterrupt()))
    join._wait_for_run(address, Credentials(made, "actor"), 3600.0, came)
    assert len(came) == 1
