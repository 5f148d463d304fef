"""Machines that join a run over TLS: the curve is the same, however often the link between them is cut."""

import json
import re
import signal
import socket
import tempfile
import threading
import time
from pathlib import Path

import pytest

from railctl.common.locks import living
from railctl.common.records.control import LearnerCommand
from railctl.common.wire.keys import COMMAND_LEARNER, EPISODE_ROWS
from railctl.deploy.certificates import create
from railctl.deploy.runs import reach
from railctl.tools.bench.machines import Machine, NoMachinesError, ip

PATIENCE_S = 300.0
LINK = 7


@pytest.fixture
def keys(tmp_path):
    create(tmp_path / "keys", [Machine(LINK).here], ["127.0.0.1"])
    return tmp_path / "keys"


@pytest.fixture(autouse=True)
def nothing_is_left():
    """Every test ends with the folders of machines that join as it began."""
    before = joined_folders()
    yield
    assert joined_folders() == before


def joined_folders():
    return set(Path(tempfile.gettempdir()).glob("railctl-join-*"))


@pytest.fixture
def port():
    return free_port()


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


@pytest.fixture
def elsewhere():
    """As good as another machine, but for its link."""
    try:
        machine = Machine(LINK).__enter__()
    except NoMachinesError as reason:
        pytest.skip(str(reason))
    yield machine
    machine.__exit__()


def begin_held(clusters, name, address, keys):
    """Start a run that waits for `resume`; its learner sees the file when it has started, which takes seconds."""
    clusters.up(name, "--detach", "--listen", address, "--keys", str(keys))
    clusters.folder(name).paused_file.touch()


def join_by(clusters, address, keys, *before):
    """Start `railctl join`, which waits until the run listens: `up --detach` returns before."""
    return clusters.start_by(before, "join", address, "--keys", str(keys), "--actors", "easy=1", "--wait", "300")


def far_actors(clusters, name):
    """Those who have joined, by name."""
    return {process["process"] for process in clusters.status(name)["processes"] if is_far(process["process"])}


def resume(clusters, name):
    """Go on with a run that is paused, once its learner is there."""
    clusters.wait(lambda: clusters.status(name)["state"] == "paused")
    clusters.tell_learner(name, "resume")


def is_far(actor):
    """Those of the run's own machine are `actor-easy-0` and so on."""
    return re.fullmatch(r"actor-.+-\d+-easy-0", actor) is not None


def heard_since(clusters, name, moment):
    """The actor that has joined has been heard, later than at some moment and after its start."""
    for process in clusters.status(name)["processes"]:
        if is_far(process["process"]) and process["state"] != "starting":
            return process["last_heartbeat_unix_s"] > moment
    return False


def left(joiner, code=0):
    """What a `railctl join` says at its end."""
    said, complained = joiner.communicate(timeout=PATIENCE_S)
    assert joiner.returncode == code, complained
    return complained.splitlines()[-1] if code else said


def test_a_machine_that_joins_acts_the_same_curve(clusters, undisturbed, keys, port, tail):
    address = f"tls/127.0.0.1:{port}"
    begin_held(clusters, "joined", address, keys)
    joiner = join_by(clusters, address, keys)
    clusters.wait(lambda: heard_since(clusters, "joined", 0))
    rows = tail("joined")
    resume(clusters, "joined")
    rows.until(5)
    clusters.kill("joined", "router")
    rows.rest()
    assert left(joiner) == "all episodes are trained\n"
    clusters.wait(lambda: not living(clusters.folder("joined")))
    assert clusters.curve("joined") == undisturbed
    assert any(map(is_far, clusters.actors("joined")))


def test_who_waited_and_joined_leaves_with_ctrl_c_or_sigterm_and_the_learner_acts_on(clusters, undisturbed, keys, port):
    address = f"tls/127.0.0.1:{port}"
    joiners = [clusters.start("join", address, "--keys", str(keys), "--actors", "easy=1", "--wait", "300")]
    assert "waits for the run" in joiners[0].stderr.readline()
    begin_held(clusters, "left", address, keys)
    joiners.append(join_by(clusters, address, keys))
    clusters.wait(lambda: len(far_actors(clusters, "left")) == 2)
    joiners[0].send_signal(signal.SIGINT)
    assert left(joiners[0]) == "left the run\n"
    joiners[1].terminate()
    assert left(joiners[1], 1) == "railctl: SIGTERM: left the run before it was trained"
    clusters.wait(lambda: not heard_since(clusters, "left", 0))
    resume(clusters, "left")
    clusters.wait(lambda: not living(clusters.folder("left")))
    assert clusters.curve("left") == undisturbed


@pytest.mark.slow
def test_who_joined_waits_while_the_whole_run_is_down(clusters, undisturbed, keys, port, tail):
    address = f"tls/127.0.0.1:{port}"
    begin_held(clusters, "down", address, keys)
    joiner = join_by(clusters, address, keys)
    clusters.wait(lambda: heard_since(clusters, "down", 0))
    rows = tail("down")
    resume(clusters, "down")
    rows.until(5)
    clusters.pause("down")
    clusters.railctl("down", "down")
    up_at = time.time()
    clusters.railctl("up", "--name", "down", "--detach")
    clusters.wait(lambda: heard_since(clusters, "down", up_at))
    resume(clusters, "down")
    left(joiner)
    clusters.wait(lambda: not living(clusters.folder("down")))
    assert clusters.curve("down") == undisturbed
    assert is_far(last_actor(clusters, "down"))


@pytest.mark.slow
def test_who_joined_through_a_relay_goes_on_through_the_next_one(clusters, undisturbed, keys, port, tail):
    address, gate = f"tls/127.0.0.1:{port}", f"tls/127.0.0.1:{free_port()}"
    begin_held(clusters, "relayed", address, keys)
    clusters.wait(lambda: clusters.status("relayed")["state"] == "paused")
    relay = start_relay(clusters, address, gate, keys)
    joiner = join_by(clusters, gate, keys)
    clusters.wait(lambda: heard_since(clusters, "relayed", 0))
    rows = tail("relayed")
    resume(clusters, "relayed")
    rows.until(3)
    clusters.pause("relayed")
    relay.kill()
    relay = start_relay(clusters, address, gate, keys)
    began_at = time.time()
    clusters.wait(lambda: heard_since(clusters, "relayed", began_at))
    clusters.railctl("down", "relayed")  # the relay outlives the host
    clusters.railctl("up", "--name", "relayed", "--detach")
    up_at = time.time()
    clusters.wait(lambda: heard_since(clusters, "relayed", up_at))
    resume(clusters, "relayed")
    left(joiner)
    clusters.wait(lambda: not living(clusters.folder("relayed")))
    relay.send_signal(signal.SIGINT)
    assert relay.wait(PATIENCE_S) == 0
    assert clusters.curve("relayed") == undisturbed
    assert is_far(last_actor(clusters, "relayed"))


def start_relay(clusters, address, gate, keys):
    """Start `railctl relay`, and wait for its link to the host."""
    relay = clusters.start("relay", address, "--listen", gate, "--keys", str(keys))
    assert relay.stdout.readline() == f"links {gate} to {address}\n"
    return relay


@pytest.mark.slow
@pytest.mark.parametrize("cut_s", [2, 10, 60])
def test_a_cut_link_changes_nothing(clusters, undisturbed, keys, port, elsewhere, cut_s):
    name, address = f"cut-{cut_s}", f"tls/{elsewhere.here}:{port}"
    begin_held(clusters, name, address, keys)
    joiner = join_by(clusters, address, keys, *elsewhere.command())
    clusters.wait(lambda: heard_since(clusters, name, 0))
    cut_at_the_fifth_episode(clusters, name, elsewhere)
    assert len(clusters.curve(name)) < len(undisturbed)
    threading.Event().wait(cut_s)
    ip("link", "set", elsewhere.link, "up")
    mended_at = time.time()
    clusters.wait(lambda: heard_since(clusters, name, mended_at))
    resume(clusters, name)
    left(joiner)
    clusters.wait(lambda: not living(clusters.folder(name)))
    assert clusters.curve(name) == undisturbed
    assert is_far(last_actor(clusters, name))


def cut_at_the_fifth_episode(clusters, name, elsewhere):
    """Cut the link and hold the run at once: two seconds later its learner would do the rest by itself."""
    clusters.wait(lambda: clusters.status(name)["state"] == "paused")
    fifth = threading.Event()
    with reach(clusters.folder(name)) as bus:
        bus.subscribe(EPISODE_ROWS, lambda row: fifth.set() if row.episode >= 4 else None)
        assert bus.ask(COMMAND_LEARNER, LearnerCommand(verb="resume"), PATIENCE_S).done
        assert fifth.wait(PATIENCE_S)
        ip("link", "set", elsewhere.link, "down")
        assert bus.ask(COMMAND_LEARNER, LearnerCommand(verb="pause"), PATIENCE_S).done


def last_actor(clusters, name):
    """Who acted the last episode."""
    return json.loads(clusters.folder(name).episodes_file.read_text().splitlines()[-1])["actor"]
