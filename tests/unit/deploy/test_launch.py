"""Every check comes before the first file or process, and a start that fails leaves nothing behind."""

import errno
import json
import os
import socket
import stat
import subprocess
from pathlib import Path

import numpy as np
import pytest
from made_rows import episode_row

from railctl.common import checkpoint
from railctl.common.interpreter import PYTHON
from railctl.common.locks import sole
from railctl.common.private import is_private, remove_endpoint
from railctl.common.strict import ConfigError, shortened
from railctl.deploy import launch
from railctl.deploy.certificates import create
from railctl.deploy.launch import (
    check_door,
    check_existing,
    check_machine,
    fresh_name,
    new_run,
    start_supervisor,
    write_cluster_file,
)
from railctl.deploy.resolve import resolve
from railctl.deploy.runs import Failed, supervised

HOLD = """
import sys
from pathlib import Path
from railctl.common.folder import RunFolder
from railctl.common.locks import sole
from railctl.common.private import is_private, remove_endpoint
with sole(RunFolder(Path(sys.argv[1])), "supervisor"):
    sys.stdin.read()
"""
ROW = episode_row(0, actor="learner").model_dump_json(by_alias=True)


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


def config(**cluster):
    return resolve({"episodes": 10, "cluster": {"cores": 1} | cluster})


def failure(call, *arguments, error=Failed):
    with pytest.raises(error) as caught:
        call(*arguments)
    text = str(caught.value)
    assert "\n" not in text
    return text


# Names


@pytest.mark.parametrize("name", ["one", "1", "a.b-c_d", "A" * 100])
def test_a_new_run_has_its_configuration_and_a_folder_for_logs(root, name):
    folder = new_run(name, config())
    assert folder.path == root / name
    assert folder.config() == config()
    assert sorted(path.name for path in folder.path.iterdir()) == ["config.yaml", "logs"]
    assert [path.name for path in root.iterdir()] == [name]


@pytest.mark.parametrize("name", ["", ".hidden", "-dash", "a b", "a/b", "../up", "a" * 101, "é", "a:b", "a" * 5000])
def test_a_name_of_another_form_is_refused_and_nothing_is_made(root, name):
    text = failure(new_run, name, config(), error=ConfigError)
    assert text == f"--name {shortened(name)}: use letters, digits, '.', '_', '+' and '-', at most 100"
    assert not root.exists()


def test_a_name_that_ends_in_a_newline_is_refused(root):
    failure(new_run, "one\n", config(), error=ConfigError)


def test_a_fresh_name_tells_what_the_run_is_and_is_free(root, monkeypatch):
    class Noon(launch.datetime):
        @classmethod
        def now(cls):
            return cls(2020, 1, 2, 12, 0, 0)

    monkeypatch.setattr(launch, "datetime", Noon)
    mixed = resolve({"mix": {"easy": 0.5, "hard": 0.5}, "seed": 7})
    assert fresh_name(mixed) == "dddqn-easy-hard-seed7-20200102-120000"
    (root / "dddqn-easy-hard-seed7-20200102-120000").mkdir(parents=True)
    (root / "dddqn-easy-hard-seed7-20200102-120000-2").mkdir()
    assert fresh_name(mixed) == "dddqn-easy-hard-seed7-20200102-120000-3"
    assert launch.NAME_FORM.fullmatch(fresh_name(mixed))


def test_a_fresh_name_is_one_however_many_levels_there_are(root):
    tiny = {"rules": "stock", "size": [20, 20], "trains": 2, "cities": 2}
    levels = {f"{'x' * 39}{number}": tiny for number in range(5)}
    mixed = resolve({"levels": levels, "mix": dict.fromkeys(levels, 0.2)})
    assert launch.NAME_FORM.fullmatch(fresh_name(mixed))
    assert fresh_name(mixed).startswith(f"dddqn-{'x' * 39}0-seed1-")


# What cannot be written


def forbid(monkeypatch, *names):
    def refuse(path, *_arguments, **_options):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    for name in names:
        monkeypatch.setattr(Path, name, refuse)


@pytest.mark.parametrize("what", ["mkdir", "rename", "open"])
def test_a_run_that_cannot_be_written_leaves_nothing_behind(root, monkeypatch, what):
    root.mkdir()
    forbid(monkeypatch, what)
    text = failure(new_run, "one", config())
    assert text == (f"cannot create {root}/one: Permission denied: set RAILCTL_RUNS to a folder that you may write")
    assert list(root.iterdir()) == []


def test_a_folder_of_that_name_is_not_overwritten(root):
    (root / "one").mkdir(parents=True)
    (root / "one" / "notes.txt").write_text("mine")
    text = failure(new_run, "one", config(), error=ConfigError)
    assert text == f"{root}/one is there, without its config.yaml: restore that, or give another name"
    assert [path.name for path in root.iterdir()] == ["one"]
    assert (root / "one" / "notes.txt").read_text() == "mine"


def test_a_file_in_the_place_of_the_runs_is_named(root):
    root.write_text("a file")
    assert failure(new_run, "one", config()).startswith(f"cannot create {root}/one: ")
    assert root.read_text() == "a file"


# What the machine lacks


def test_more_cores_than_there_are_are_refused_before_anything_is_made(root, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0, 1, 2})
    check_machine(config(cores=3))
    text = failure(new_run, "one", config(cores=4))
    assert text == "cluster.cores is 4 and this machine offers 3: use --cores 3"
    assert not root.exists()


# Runs that exist


@pytest.fixture
def run(root):
    return new_run("one", config())


def test_an_existing_run_is_checked_and_left_as_it_is(run):
    before = sorted(run.path.rglob("*"))
    check_existing(run, config())
    assert sorted(run.path.rglob("*")) == before


def test_a_read_only_run_is_refused(run, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: (Path(path), mode) != (run.path, os.W_OK))
    assert failure(check_existing, run, config()) == (
        f"cannot write to {run.path}: make it writable, or copy the run to another folder"
    )


def save_snapshot(run, episodes, settings):
    run.snapshots.mkdir(exist_ok=True)
    path = run.snapshots / f"{episodes:08d}.safetensors"
    metadata = {"science": json.dumps(settings.science), "episode": str(episodes)}
    checkpoint.save(path, {"w": np.ones(3, np.float32)}, metadata, "snapshot")
    return path


def test_a_run_goes_on_as_long_as_one_of_its_snapshots_can_be_read(run):
    older, newest = save_snapshot(run, 0, config()), save_snapshot(run, 1, config())
    newest.write_bytes(newest.read_bytes()[:-1] + b"\xff")
    check_existing(run, config())
    older.write_bytes(b"damaged")
    assert failure(check_existing, run, config()).startswith(f"{newest}: damaged")


def test_a_snapshot_of_another_configuration_is_refused(run):
    save_snapshot(run, 0, config())
    other = config().model_copy(update={"seed": 99})
    assert failure(check_existing, run, other).startswith("the newest snapshot has another configuration: restore ")


def test_a_snapshot_whose_rows_are_cut_off_is_refused(run):
    save_snapshot(run, 1, config())
    run.episodes_file.write_text(ROW[:40])
    assert "does not hold the 1 episodes of the newest snapshot" in failure(check_existing, run, config())


@pytest.mark.parametrize("name", ["episodes", "evaluations", "metrics", "events"])
def test_a_damaged_row_is_refused(run, name):
    path = run.path / f"{name}.jsonl"
    path.write_text(f"{ROW[:40]}\n")
    assert failure(check_existing, run, config()).startswith(f"{path} line 1 is not a valid row: ")


@pytest.mark.parametrize("name", ["checkpoints", "snapshots", "tensorboard", "processes", "logs"])
@pytest.mark.parametrize("make", [Path.touch, lambda path: path.symlink_to("nowhere")], ids=["file", "nothing"])
def test_what_is_no_folder_is_refused(run, name, make):
    path = run.path / name
    if path.exists():
        path.rmdir()
    make(path)
    assert failure(check_existing, run, config()) == f"{path} is no folder: move it away"
    assert not supervised(run)


FILES = [
    "episodes.jsonl",
    "events.jsonl",
    "weights.board",
    "cluster.json",
    "outcome.json",
    "paused",
    "logs/learner.log",
]


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize(
    "make", [Path.mkdir, os.mkfifo, lambda path: path.symlink_to("nowhere")], ids=["folder", "pipe", "nothing"]
)
def test_what_is_no_file_is_refused(run, name, make):
    path = run.path / name
    make(path)
    assert failure(check_existing, run, config()) == f"{path} is no regular file: move it away"


@pytest.mark.parametrize("namespace", ["a#b$", "**", "railctl/*", "railctl/", "railctl/12345/x"])
def test_a_prefix_of_another_form_is_refused(run, namespace):
    run.cluster_file.write_text(json.dumps({"namespace": namespace}))
    assert failure(check_existing, run, config()) == (
        f"{run.cluster_file}: namespace {shortened(namespace)} is not railctl/ and hexadecimal digits: "
        "restore it, or delete the file"
    )


def test_actors_of_levels_that_the_run_does_not_have_are_refused(run):
    run.cluster_file.write_text(json.dumps({"namespace": "railctl/1", "actors": {"easy": 1, "any": 1}}))
    check_existing(run, config())
    run.cluster_file.write_text(json.dumps({"namespace": "railctl/1", "actors": {"easy": 1, "hard": 3}}))
    assert failure(check_existing, run, config()) == (
        f"{run.cluster_file}: actors for level hard, which this run does not have: it has easy, leave the others out"
    )


def test_an_existing_run_needs_the_machine_too(run):
    assert "cluster.cores is 4096" in failure(check_existing, run, config(cores=4096))


# The cluster's file


def test_the_cluster_listens_on_a_private_socket_and_keeps_its_namespace(run):
    write_cluster_file(run, config(actors={"easy": 2, "any": 1}))
    first = json.loads(run.cluster_file.read_text())
    assert is_private(first["endpoint"])
    assert first["actors"] == {"easy": 2, "any": 1}
    assert first["namespace"].startswith("railctl/")
    write_cluster_file(run, config())
    assert json.loads(run.cluster_file.read_text()) == first  # as many actors as there were
    remove_endpoint(first["endpoint"])  # as the supervisor does at the end
    write_cluster_file(run, config())
    second = json.loads(run.cluster_file.read_text())
    assert is_private(second["endpoint"])
    assert second == first | {"endpoint": second["endpoint"]}
    run.cluster_file.write_text("{")
    write_cluster_file(run, config())
    assert json.loads(run.cluster_file.read_text())["namespace"] != first["namespace"]


def test_a_run_is_its_users_alone(run, supervisor):
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in [run.path, *run.path.iterdir()]}
    assert modes == {"one": 0o700, "config.yaml": 0o600, "logs": 0o700}
    run.path.chmod(0o755)  # as earlier versions made them
    supervisor(HOLD)
    start_supervisor(run, config())
    assert stat.S_IMODE(run.path.stat().st_mode) == 0o700


def test_two_runs_have_namespaces_of_their_own(root):
    runs = [new_run(name, config()) for name in ("one", "two")]
    for folder in runs:
        write_cluster_file(folder, config())
    assert len({folder.endpoint_and_namespace()[1] for folder in runs}) == 2


# The supervisor


@pytest.fixture
def supervisor(monkeypatch):
    """Puts another program in the supervisor's place."""
    started = []

    def use(code):
        def start(command, **options):
            assert command[:4] == [*PYTHON, "-m", "railctl.deploy.supervise"]
            child = subprocess.Popen([*PYTHON, "-c", code, command[-1]], **options | {"stdin": subprocess.PIPE})
            started.append((child, options))
            return child

        monkeypatch.setattr(launch, "subprocess", Faked(start))
        return started

    yield use
    for child, _ in started:
        child.stdin.close()
        child.wait()


class Faked:
    """The module subprocess with another Popen."""

    DEVNULL, STDOUT = subprocess.DEVNULL, subprocess.STDOUT

    def __init__(self, popen):
        self.Popen = popen


def test_starting_returns_when_the_supervisor_has_its_place(run, supervisor):
    started = supervisor(HOLD)
    run.outcome_file.write_text('{"outcome": "stopped", "reason": ""}')
    pid = start_supervisor(run, config())
    [(child, options)] = started
    assert child.pid == pid
    assert options["start_new_session"]  # Ctrl-C in the terminal is not for it
    assert options["env"]["OMP_NUM_THREADS"] == "1"
    assert not run.outcome_file.exists()  # of the time before
    assert json.loads(run.cluster_file.read_text())["actors"] == {"easy": 0}


def test_a_supervisor_that_ends_at_once_is_a_failure_with_its_last_words(run, supervisor):
    supervisor("print('first'); print('no more room')")
    assert failure(start_supervisor, run, config()) == "the supervisor did not start: no more room"


def test_a_supervisor_that_ends_without_a_word_is_a_failure_too(run, supervisor):
    supervisor("")
    assert failure(start_supervisor, run, config()) == "the supervisor did not start: it left no word"


def test_a_start_that_the_system_refuses_leaves_the_word_of_the_last_end(run):
    run.outcome_file.write_text('{"outcome": "stopped", "reason": ""}')
    run.logs.rmdir()
    run.logs.touch()
    failure(start_supervisor, run, config(), error=FileExistsError)
    assert run.outcome().outcome == "stopped"


def test_ctrl_c_meanwhile_ends_the_supervisor_too(run, supervisor, monkeypatch):
    started = supervisor("import time; time.sleep(600)")

    def interrupted(_seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr(launch.time, "sleep", interrupted)
    with pytest.raises(KeyboardInterrupt):
        start_supervisor(run, config())
    [(child, _options)] = started
    assert child.poll() is not None


def test_processes_that_live_keep_their_cluster(run, supervisor):
    supervisor(HOLD)
    write_cluster_file(run, config())
    before = run.cluster_file.read_text()
    with sole(run, "learner"):
        start_supervisor(run, config(actors={"easy": 2}))
    assert run.cluster_file.read_text() == before


def test_actors_asked_for_when_taking_over_are_wanted(run, supervisor):
    supervisor(HOLD)
    write_cluster_file(run, config())
    endpoint = json.loads(run.cluster_file.read_text())["endpoint"]
    with sole(run, "learner"):
        start_supervisor(run, config(), {"easy": 3})
    cluster = json.loads(run.cluster_file.read_text())
    assert cluster["actors"] == {"easy": 3}
    assert cluster["endpoint"] == endpoint  # what lives stays reachable


# Other machines


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    made = tmp_path_factory.mktemp("far") / "keys"
    create(made, [])
    return made


@pytest.fixture
def taken():
    """An address at which somebody listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tls/127.0.0.1:{server.getsockname()[1]}"


def test_an_address_is_free_until_somebody_listens(root, keys, taken):
    free = taken.replace("127.0.0.1", "127.0.0.2")
    assert new_run("one", config(listen=free, keys=str(keys))).config().cluster.listen == free
    text = failure(new_run, "two", config(listen=taken, keys=str(keys)))
    assert text.startswith(f"cluster.listen {taken}: Address already in use: give a free port, ")
    assert [path.name for path in root.iterdir()] == ["one"]


@pytest.mark.parametrize("host", ["192.0.2.1", "nosuch.invalid"])
def test_an_address_of_another_machine_cannot_be_listened_on(root, keys, host):
    text = failure(new_run, "one", config(listen=f"tls/{host}:7447", keys=str(keys)))
    assert text.startswith(f"cluster.listen tls/{host}:7447: ")
    assert not root.exists()


def test_keys_that_are_not_there_are_refused_before_anything_is_made(root, tmp_path):
    text = failure(new_run, "one", config(listen="tls/127.0.0.1:7447", keys=str(tmp_path / "none")), error=ConfigError)
    assert text.startswith(f"{tmp_path}/none/ca.pem cannot be read: No such file or directory: ")
    assert not root.exists()


def test_a_router_that_lives_goes_on_listening_where_it_does(run, keys, taken):
    check_door(run, config())
    elsewhere = config(listen=taken.replace("127.0.0.1", "127.0.0.2"), keys=str(keys))
    check_door(run, elsewhere)
    with sole(run, "router"):
        check_door(run, config())
        text = failure(check_door, run, elsewhere)
    assert text == "run one is running, and its router listens elsewhere: railctl down one first"


def test_a_router_that_lives_is_not_in_its_own_way(root, keys, taken):
    listening = config(listen=taken.replace("127.0.0.1", "127.0.0.2"), keys=str(keys))
    folder = new_run("one", listening)
    port = int(taken.rpartition(":")[2])
    with socket.create_server(("127.0.0.2", port)), sole(folder, "router"):
        check_door(folder, listening)
