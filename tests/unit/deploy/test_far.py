"""Reaching a run by its address: who is there, and what is wrong if nobody is."""

import json
import shutil
import socket
import threading
from contextlib import ExitStack

import pytest
from command_line import complaint, railctl

from railctl.common.bus import NoAnswer, open_bus, open_router
from railctl.common.private import private_endpoint, remove_endpoint
from railctl.common.records.control import CommandAnswer, Status
from railctl.common.records.joining import RunIntroduction
from railctl.common.records.rows import EpisodeRows, EvaluationRow, EvaluationRows
from railctl.common.sessions import Door
from railctl.common.strict import ConfigError
from railctl.common.task import FAILED, WRONG_USAGE
from railctl.common.tls import Credentials
from railctl.common.wire import keys
from railctl.deploy.certificates import create
from railctl.deploy.far import credentials_for, introduced, reach_far, shake_hands

NAMESPACE = "railctl/0123456789ab"
RUN = RunIntroduction(name="one", namespace=NAMESPACE, config="seed: 1")
PATIENCE_S = 10.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("far") / "keys"
    create(made, [])
    return made


@pytest.fixture(scope="module")
def address():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"tls/127.0.0.1:{free.getsockname()[1]}"


@pytest.fixture(scope="module")
def near(folder, address):
    """The run's own machine."""
    endpoint = private_endpoint()
    with ExitStack() as stack:
        stack.callback(remove_endpoint, endpoint)
        stack.enter_context(open_router(endpoint, Door(address, NAMESPACE, Credentials(folder, "host"))))
        yield stack.enter_context(open_bus(endpoint, NAMESPACE, PATIENCE_S))


def nobody(call, *arguments):
    with pytest.raises(NoAnswer) as caught:
        call(*arguments)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_a_run_that_does_not_answer_is_named_by_its_address(near, address, folder):
    credentials = credentials_for(address, folder, "actor")
    assert nobody(introduced, address, credentials).startswith(f"{address}: no run says its name: ")


def test_a_run_is_found_by_its_address(near, address, folder):
    near.serve(keys.RUN, lambda question: question.answer(RUN))
    credentials = credentials_for(address, folder, "actor")
    assert introduced(address, credentials) == RUN
    with reach_far(address, credentials) as (bus, run):
        assert run == RUN
        assert bus.connected()


def test_a_host_of_another_making_is_none_to_talk_to(near, address, tmp_path):
    create(tmp_path / "keys", [])
    text = nobody(shake_hands, address, Credentials(tmp_path / "keys", "actor"))
    assert "certificate" in text
    assert text.endswith(f"and {tmp_path}/keys must be of the same")


def test_who_knows_no_tls_is_none_to_talk_to(folder):
    with socket.create_server(("127.0.0.1", 0)) as plain:

        def hang_up():
            plain.accept()[0].close()

        answering = threading.Thread(target=hang_up)
        answering.start()
        text = nobody(shake_hands, f"tls/127.0.0.1:{plain.getsockname()[1]}", Credentials(folder, "actor"))
        answering.join()
    assert "is the run up with --listen, " in text


def test_an_address_that_the_certificate_does_not_name_is_said(tmp_path):
    create(tmp_path / "keys", [])
    endpoint = private_endpoint()
    with socket.create_server(("127.0.0.2", 0)) as free:
        address = f"tls/127.0.0.2:{free.getsockname()[1]}"
    with open_router(endpoint, Door(address, NAMESPACE, Credentials(tmp_path / "keys", "host"))):
        text = nobody(shake_hands, address, Credentials(tmp_path / "keys", "actor"))
    remove_endpoint(endpoint)
    assert "127.0.0.2" in text
    assert "railctl keys create --host 127.0.0.2 makes keys for it" in text


def test_an_address_where_nobody_listens_is_named(folder):
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tls/127.0.0.1:{free.getsockname()[1]}"
    text = nobody(shake_hands, address, Credentials(folder, "actor"))
    assert text.startswith(f"{address}: Connection refused: is the run up with --listen, ")


def test_a_name_that_nobody_has_is_named(folder):
    text = nobody(shake_hands, "tls/nosuch.invalid:7447", Credentials(folder, "actor"))
    assert text.startswith("tls/nosuch.invalid:7447: ")


def test_what_is_no_address_or_lacks_a_file_is_refused_before_anybody_is_asked(folder, tmp_path):
    with pytest.raises(ConfigError, match=r"^'tcp/127\.0\.0\.1:1' is not tls/HOST:PORT: "):
        credentials_for("tcp/127.0.0.1:1", folder, "actor")
    shutil.copytree(folder, tmp_path / "keys")
    (tmp_path / "keys" / "actor.key").unlink()
    with pytest.raises(ConfigError, match=r"/actor.key cannot be read: No such file or directory: "):
        credentials_for("tls/127.0.0.1:1", tmp_path / "keys", "actor")


# An address in place of a run's name


STATUS = Status(
    run="one",
    path="runs/one",
    state="running",
    algorithm="dddqn",
    episodes=10,
    supervisor_pid=1,
    progress=None,
    time_left_s=None,
    problems=[],
    processes=[],
)


@pytest.fixture(scope="module")
def answering(near):
    """A run that answers; all that it was asked to change."""
    asked = []

    def obey(question):
        asked.append(question.request.model_dump())
        question.answer(CommandAnswer(done=True, text="done so"))

    near.serve(keys.RUN, lambda question: question.answer(RUN))
    near.serve(keys.STATUS, lambda question: question.answer(STATUS))
    for service in (keys.SCALE, keys.COMMAND_LEARNER, keys.STOP):
        near.serve(service, obey)
    near.serve(keys.EPISODE_HISTORY, lambda question: question.answer(EpisodeRows(rows=[], total=0)))
    near.serve(keys.EVALUATION_HISTORY, lambda question: question.answer(EvaluationRows(rows=EVALUATIONS, total=1)))
    return asked


@pytest.fixture
def run(answering):
    """The same, of a test."""
    answering.clear()
    return answering


EVALUATIONS = [
    EvaluationRow(
        mode="greedy",
        episode=5,
        level="easy",
        levels=10,
        normalised_return=-0.25,
        arrived_share=0.75,
        all_arrived_share=0.5,
        mean_steps=41.5,
        score=None,
        evaluated_unix_s=1000.0,
        evaluating_s=0.5,
        weights_digest="0" * 32,
    )
]


def only(folder, tmp_path, role):
    """The keys that a machine of one role has."""
    theirs = tmp_path / role
    theirs.mkdir()
    for name in ("ca.pem", f"{role}.pem", f"{role}.key"):
        shutil.copy(folder / name, theirs)
    return theirs


@pytest.mark.parametrize("role", ["reader", "operator"])
def test_the_status_of_a_run_is_seen_from_anywhere(run, address, folder, tmp_path, role):
    found = railctl("status", address, "--keys", only(folder, tmp_path, role), "--json")
    told = json.loads(found.stdout)
    assert told.pop("events") == []  # which are written down where the run is
    assert Status.model_validate_json(json.dumps(told)) == STATUS


def test_an_operator_scales_a_run_from_anywhere(run, address, folder, tmp_path):
    assert railctl("scale", address, "easy=3", "--keys", only(folder, tmp_path, "operator")).stdout == "done so\n"
    assert run == [{"actors": {"easy": 3}}]


@pytest.mark.parametrize("verb", ["pause", "resume", "checkpoint"])
def test_an_operator_has_a_learner_told_from_anywhere(run, address, folder, tmp_path, verb):
    assert railctl(verb, address, "--keys", only(folder, tmp_path, "operator")).stdout == "done so\n"
    assert run == [{"verb": verb}]


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_an_operator_stops_a_run_from_anywhere(run, address, folder, tmp_path, monkeypatch, force):
    monkeypatch.setattr("railctl.common.bus.Bus.connected", lambda _bus: len(run) <= len(force))
    said = railctl("down", address, "--keys", only(folder, tmp_path, "operator"), *force).stdout
    assert said == "run one stops, and its link has ended; railctl up --name one goes on, on its machine\n"
    assert run == [{}] * (1 + len(force))


def test_a_run_that_does_not_stop_is_said(run, address, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("railctl.deploy.commands.down.PATIENCE_S", 0.1)
    theirs = only(folder, tmp_path, "operator")
    said = complaint(FAILED, "down", address, "--keys", theirs)
    assert said == f"railctl: run one does not stop: railctl down {address} --keys {theirs} --force"


def test_a_tail_from_elsewhere_has_history_and_ends_with_the_link(run, address, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("railctl.common.bus.Bus.connected", lambda _bus: False)
    found = railctl("tail", address, "--keys", only(folder, tmp_path, "reader"))
    assert found.stdout.startswith("checkpoint   5  easy    greedy  -0.250  ")
    assert found.stderr.startswith(f"railctl: no link to {address} any more: ")


@pytest.mark.parametrize("command", [("status",), ("tail",), ("scale", "easy=1"), ("pause",), ("down",)])
def test_the_keys_of_an_actor_show_and_change_nothing(address, folder, tmp_path, command):
    theirs = only(folder, tmp_path, "actor")
    text = complaint(WRONG_USAGE, command[0], address, *command[1:], "--keys", theirs)
    wanted = "reader" if command[0] in ("status", "tail") else "operator"
    assert text.startswith(f"railctl: {theirs}/{wanted}.pem cannot be read: ")


@pytest.mark.parametrize("command", ["status", "tail"])
def test_an_address_takes_keys_and_a_name_takes_none(address, folder, command):
    assert complaint(WRONG_USAGE, command, address) == (
        f"railctl: {address}: an address takes keys: add --keys DIR, with those of a reader or an operator"
    )
    for name in (["one"], []):
        text = complaint(WRONG_USAGE, command, *name, "--keys", folder)
        assert text.startswith(f"railctl: --keys {folder}: only the address of a run takes keys, ")


def test_a_relay_listens_nowhere_but_at_a_free_address(near, tmp_path, address):
    create(tmp_path / "keys", [], ["127.0.0.1"])
    said = complaint(FAILED, "relay", address, "--keys", tmp_path / "keys", "--listen", address)
    remedy = "give a free port, and 0.0.0.0 or an address of this machine"
    assert said == f"railctl: --listen {address}: Address already in use: {remedy}"
