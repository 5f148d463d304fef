"""Who may do what over a real router: its own machine everything, other machines what their certificates say."""

import json
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
import uuid
from contextlib import ExitStack
from queue import SimpleQueue

import pytest
import zenoh

from railctl.common import sessions
from railctl.common.bus import NoAnswer, open_bus, open_relay, open_router
from railctl.common.interpreter import PYTHON
from railctl.common.private import private_endpoint, remove_endpoint
from railctl.common.records.control import Empty
from railctl.common.records.joining import RunIntroduction
from railctl.common.sessions import Door
from railctl.common.tls import Credentials
from railctl.common.wire import keys
from railctl.common.wire.keys import Service, Topic, absolute
from railctl.common.wire.rights import BEHIND_A_RELAY, RIGHTS
from railctl.deploy.certificates import create

PATIENCE_S = 10.0
REFUSED_S = 1.0  # a link that is refused is tried again until then
TOPICS = [value for value in vars(keys).values() if isinstance(value, Topic)]
SERVICES = [value for value in vars(keys).values() if isinstance(value, Service)]
MANY = 60
PLACES = (("host", RIGHTS), ("relay", BEHIND_A_RELAY))
CASES = [(place, role, rights[role]) for place, rights in PLACES for role in rights]

ASKER = """
import sys
import zenoh
settings, key, times = sys.argv[1:]
session = zenoh.open(zenoh.Config.from_json5(settings))
for _ in range(int(times)):
    session.get(key, lambda reply: None, timeout=3600.0)
sys.stdin.read()
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("keys") / "ours"
    create(made, [], ["127.0.0.1"])
    return made


@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    made = tmp_path_factory.mktemp("keys") / "foreign"
    create(made, [])
    return made


class Cluster:
    """A router with a door, and a session of its own machine; others come to the host itself or through a relay."""

    def __init__(self, folder, stack, place):
        self.namespace = f"railctl/{uuid.uuid4().hex[:12]}"
        self.endpoint = private_endpoint()
        stack.callback(remove_endpoint, self.endpoint)
        host = self.address = free_address()
        stack.enter_context(open_router(self.endpoint, Door(host, self.namespace, Credentials(folder, "host"))))
        if place == "relay":
            self.address = free_address()
            stack.enter_context(open_relay(self.address, host, Credentials(folder, "relay")))
        self.near = stack.enter_context(opened(sessions.client(self.endpoint, PATIENCE_S, None)))

    def far(self, credentials):
        return opened(sessions.client(self.address, PATIENCE_S, credentials))

    def key(self, channel):
        return absolute(self.namespace, channel.key)


def free_address():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"tls/127.0.0.1:{free.getsockname()[1]}"


def opened(settings):
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


@pytest.fixture
def cluster(folder, request):
    with ExitStack() as stack:
        yield Cluster(folder, stack, getattr(request, "param", "host"))


@pytest.fixture
def far(cluster, folder, request):
    with cluster.far(Credentials(folder, request.param)) as session:
        yield session


def answers(session, key):
    return [reply.ok.payload.to_string() for reply in session.get(key, timeout=PATIENCE_S) if reply.ok is not None]


def serve(session, key, text):
    def reply(query):
        with query:
            query.reply(query.key_expr, text)

    return session.declare_queryable(key, reply)


def passed(cluster, far):
    """All that both have sent before is through, or refused."""
    served = serve(cluster.near, cluster.key(keys.RUN), "through")
    deadline = time.monotonic() + PATIENCE_S
    while "through" not in answers(far, cluster.key(keys.RUN)):
        assert time.monotonic() < deadline
    served.undeclare()


def each_role(test):
    names = [f"{role} at the {place}" for place, role, _ in CASES]
    return pytest.mark.parametrize(("cluster", "far", "rights"), CASES, ids=names, indirect=["cluster", "far"])(test)


class Heard:
    """What comes to subscribers. Only what comes to one of them comes in order, so each of some keys has its end."""

    def __init__(self, session, keys, awaited):
        self.keys, self._awaited, self._ended, self._over = [], awaited, set(), threading.Event()
        self._listening = [session.declare_subscriber(key, self._hear) for key in keys]

    def _hear(self, sample):
        if sample.payload.to_string() != "last":
            self.keys.append(str(sample.key_expr))
            return
        self._ended.add(str(sample.key_expr))
        if self._ended == self._awaited:
            self._over.set()

    def wait(self):
        assert not self._awaited or self._over.wait(PATIENCE_S)


@each_role
def test_what_a_role_may_not_publish_goes_nowhere(cluster, far, rights):
    tried = [*(cluster.key(topic) for topic in TOPICS), f"{cluster.namespace}/weights"]
    may_publish = {cluster.key(topic) for topic in rights.publishes}
    heard = Heard(cluster.near, tried, may_publish)
    passed(cluster, far)
    for key in tried:
        far.put(key, b"theirs")
        far.delete(key)
        far.put(key, b"last")
    heard.wait()
    passed(cluster, far)
    assert set(heard.keys) == may_publish
    assert len(heard.keys) == len(rights.publishes)  # nothing was deleted


@each_role
def test_what_a_role_may_not_ask_is_never_heard(cluster, far, rights):
    served = [serve(cluster.near, cluster.key(service), "ours") for service in SERVICES]
    passed(cluster, far)
    found = {service for service in SERVICES if answers(far, cluster.key(service))}
    assert found == set(rights.asks)
    assert len(served) == len(SERVICES)


@each_role
def test_what_a_role_may_not_hear_does_not_reach_it(cluster, far, rights):
    may_hear = {cluster.key(topic) for topic in rights.hears}
    heard = Heard(far, [*(cluster.key(topic) for topic in TOPICS), f"{cluster.namespace}/**", "**"], may_hear)
    passed(cluster, far)
    for what in ("ours", "last"):
        for topic in TOPICS:
            cluster.near.put(cluster.key(topic), what)
    heard.wait()
    assert set(heard.keys) == may_hear


@each_role
def test_nobody_far_answers_in_place_of_the_run(cluster, far, rights):
    theirs = [serve(far, cluster.key(service), "theirs") for service in SERVICES]
    passed(cluster, far)
    assert [text for service in SERVICES for text in answers(cluster.near, cluster.key(service))] == []
    assert len(theirs) == len(SERVICES)


@each_role
def test_a_role_holds_no_token_but_its_own(cluster, far, rights):
    changes = SimpleQueue()
    watch = cluster.near.liveliness().declare_subscriber(f"{cluster.namespace}/{keys.ALL_ALIVE}", changes.put)
    passed(cluster, far)
    tokens = [far.liveliness().declare_token(f"{cluster.namespace}/alive/{kind}/x/1") for kind in ("learner", "actor")]
    passed(cluster, far)
    if rights.holds:
        assert str(changes.get(timeout=PATIENCE_S).key_expr) == f"{cluster.namespace}/alive/actor/x/1"
    assert changes.empty()
    assert len(tokens) == 2
    watch.undeclare()


@pytest.mark.parametrize("far", ["actor"], indirect=True)
def test_no_role_reaches_another_namespace(cluster, far):
    came = []
    subscriber = cluster.near.declare_subscriber("**", lambda sample: came.append(sample.key_expr))
    passed(cluster, far)
    far.put("railctl/0123456789ab/fragments", b"theirs")
    far.put("fragments", b"theirs")
    passed(cluster, far)
    assert came == []
    subscriber.undeclare()


def test_processes_of_its_own_machine_may_do_everything(cluster):
    with opened(sessions.client(cluster.endpoint, PATIENCE_S, None)) as other:
        served = [serve(other, cluster.key(service), "ours") for service in SERVICES]
        passed(cluster, other)
        assert all(answers(cluster.near, cluster.key(service)) == ["ours"] for service in SERVICES)
        assert len(served) == len(SERVICES)


# Certificates


def refused(cluster, credentials):
    with (
        pytest.raises(NoAnswer, match=f"^no router at {cluster.address}: "),
        open_bus(cluster.address, cluster.namespace, REFUSED_S, credentials=credentials),
    ):
        pass


def test_a_machine_with_keys_of_another_making_gets_no_link(cluster, foreign):
    refused(cluster, Credentials(foreign, "actor"))


def test_a_certificate_of_another_authority_gets_no_link(cluster, folder, foreign, tmp_path):
    """It takes the host for what it is; the host does not take it."""
    shutil.copytree(foreign, tmp_path / "mixed")
    shutil.copy(folder / "ca.pem", tmp_path / "mixed")
    refused(cluster, Credentials(tmp_path / "mixed", "actor"))


def test_the_hosts_own_certificate_is_none_to_connect_with(cluster, folder):
    refused(cluster, Credentials(folder, "host"))


def test_a_machine_without_a_certificate_gets_no_link(cluster, folder):
    settings = sessions.client(cluster.address, REFUSED_S, Credentials(folder, "actor"))
    for name in ("connect_certificate", "connect_private_key"):
        del settings["transport"]["link"]["tls"][name]
    with pytest.raises(zenoh.ZError):
        opened(settings)


def test_the_address_must_be_of_the_hosts_certificate(cluster, folder):
    elsewhere = cluster.address.replace("127.0.0.1", "127.0.0.2")
    with (
        pytest.raises(NoAnswer, match=r"^no router at tls/127\.0\.0\.2:"),
        open_bus(elsewhere, cluster.namespace, REFUSED_S, credentials=Credentials(folder, "actor")),
    ):
        pass


def test_a_plain_connection_gets_no_link(cluster):
    with pytest.raises(NoAnswer), open_bus(cluster.address.replace("tls", "tcp"), cluster.namespace, REFUSED_S):
        pass


def test_what_the_file_is_called_does_not_make_a_role(cluster, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "renamed")
    for end in ("pem", "key"):
        shutil.copy(folder / f"reader.{end}", tmp_path / "renamed" / f"actor.{end}")
    with cluster.far(Credentials(tmp_path / "renamed", "actor")) as far:
        served = serve(cluster.near, cluster.key(keys.LEASE), "ours")
        passed(cluster, far)
        assert answers(far, cluster.key(keys.LEASE)) == []
        served.undeclare()


def test_a_run_says_its_name_to_who_does_not_know_it(cluster, folder):
    run = RunIntroduction(name="one", namespace=cluster.namespace, config="seed: 1")
    with (
        open_bus(cluster.endpoint, cluster.namespace, PATIENCE_S) as near,
        open_bus(cluster.address, "railctl", PATIENCE_S, credentials=Credentials(folder, "reader")) as far,
    ):
        near.serve(keys.RUN, lambda question: question.answer(run))
        assert near.ask(keys.RUN, Empty(), PATIENCE_S) == run  # it is served by now
        assert far.ask(keys.RUN, Empty(), PATIENCE_S) == run


def test_a_router_without_a_door_lets_nobody_else_in(folder):
    assert "access_control" not in sessions.router("unixsock-stream//tmp/a/router", None)
    assert sessions.router("unixsock-stream//tmp/a/router", None)["listen"]["endpoints"] == [
        "unixsock-stream//tmp/a/router"
    ]


# Links that are not read


def test_who_asks_for_much_and_reads_nothing_holds_up_nobody_for_long(cluster, folder):
    settings = sessions.client(cluster.address, PATIENCE_S, Credentials(folder, "reader"))
    settings["transport"]["link"]["tx"]["lease"] = 3_600_000  # so that it is not taken for gone
    key, questions = cluster.key(keys.PULL_CHECKPOINT), SimpleQueue()
    command = [*PYTHON, "-c", ASKER, json.dumps(settings), key, str(MANY)]
    with opened(sessions.client(cluster.endpoint, PATIENCE_S, None)) as other:
        served = cluster.near.declare_queryable(key, questions.put)
        passed(cluster, other)
        with subprocess.Popen(command, stdin=subprocess.PIPE) as asker:
            try:
                asked = [questions.get(timeout=PATIENCE_S) for _ in range(MANY)]
                asker.send_signal(signal.SIGSTOP)
                os.waitpid(asker.pid, os.WUNTRACED)
                threading.Thread(target=answer_all, args=(asked, over := threading.Event()), daemon=True).start()
                assert over.wait(PATIENCE_S)
            finally:
                asker.kill()
        passed(cluster, other)
        served.undeclare()


def answer_all(questions, over):
    """With more than queues on the way have room for."""
    for question in questions:
        with question:
            question.reply(question.key_expr, bytes(1_000_000))
    over.set()


def test_a_router_waits_less_where_others_than_its_user_may_link_to_it(folder):
    keys_of = {role: Credentials(folder, role) for role in ("host", "relay", "actor")}
    door = Door("tls/127.0.0.1:1", "railctl/1", keys_of["host"])
    socket = "unixsock-stream//tmp/a/router"
    short = [sessions.router(socket, door), sessions.relay("tls/127.0.0.1:2", door.listen, keys_of["relay"])]
    long = [
        sessions.router(socket, None),
        sessions.client(socket, None, None),
        sessions.client(door.listen, None, keys_of["actor"]),
    ]
    assert [wait_us(settings) for settings in [*short, *long]] == [1_000_000] * 2 + [30_000_000] * 3
    assert sessions.WAIT_AT_A_DOOR_MS < sessions.LEASE_MS


def wait_us(settings):
    return settings["transport"]["link"]["tx"]["queue"]["congestion_control"]["block"]["wait_before_close"]
