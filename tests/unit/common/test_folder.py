"""A run's folder: where things lie, and what a missing or wrong file is called."""

import json
import os
from pathlib import Path

import pytest
import yaml

from railctl.common.bus import NoAnswer
from railctl.common.config import parse_config
from railctl.common.folder import Cluster, Outcome, RunFolder, write_atomically
from railctl.common.sessions import Door
from railctl.common.strict import ConfigError
from railctl.common.tls import Credentials

CONFIG = {
    "algorithm": "dddqn",
    "mix": {"easy": 1.0},
    "episodes": 2,
    "network": {},
    "dqn": {"learning_rate": 0.001, "batch_size": 8, "learn_every_steps": 4},
    "replay": {"capacity": 100},
    "rule": "dqn",
    "cluster": {"actors": {"easy": 1}},
}


@pytest.fixture
def folder(tmp_path):
    return RunFolder(tmp_path)


def complaint(folder):
    with pytest.raises(ConfigError) as caught:
        folder.config()
    text = str(caught.value)
    assert text.startswith(str(folder.config_file))
    return text


def test_everything_lies_within_the_folder_and_nothing_twice(folder):
    paths = [getattr(folder, name) for name, kind in vars(RunFolder).items() if isinstance(kind, property)]
    assert len(set(paths)) == len(paths) >= 10
    assert {path.parent for path in paths} == {folder.path}


def test_the_configuration_is_read_and_checked(folder):
    folder.config_file.write_text(yaml.safe_dump(CONFIG))
    assert folder.config() == parse_config(CONFIG)


def test_a_wrong_configuration_is_named_with_its_file(folder):
    assert "No such file" in complaint(folder)
    folder.config_file.write_text(yaml.safe_dump(CONFIG | {"episodes": 0}))
    assert complaint(folder) == (f"{folder.config_file}: episodes: input should be greater than or equal to 1, not 0")
    folder.config_file.write_text("- a list")
    assert complaint(folder) == f"{folder.config_file} holds no keys: write for example 'algorithm: dddqn'"


def test_a_configuration_that_is_no_yaml_is_named_in_one_line(folder):
    folder.config_file.write_text("episodes: [1\nseed: {")
    assert "\n" not in complaint(folder)


def test_a_configuration_that_is_no_text_is_named(folder):
    folder.config_file.write_bytes(b"\x89PNG\xff\xfe")
    complaint(folder)


@pytest.mark.parametrize("text", [None, "", "{", "{}", '{"endpoint": "tcp/127.0.0.1:1"}'])
def test_a_run_without_a_cluster_says_how_to_start_one(folder, text):
    if text is not None:
        folder.cluster_file.write_text(text)
    with pytest.raises(NoAnswer, match=f"run {folder.path.name} has no cluster: start one with railctl up"):
        folder.endpoint_and_namespace()


def test_where_the_cluster_is(folder):
    folder.cluster_file.write_text('{"endpoint": "tcp/127.0.0.1:1", "namespace": "railctl/1", "actors": {"easy": 1}}')
    assert folder.endpoint_and_namespace() == ("tcp/127.0.0.1:1", "railctl/1")


def test_only_who_has_joined_from_elsewhere_shows_credentials(folder):
    cluster = {"endpoint": "tls/node7:7447", "namespace": "railctl/1"}
    folder.cluster_file.write_text(json.dumps(cluster))
    assert folder.credentials() is None
    folder.cluster_file.write_text(json.dumps(cluster | {"keys": "/keys"}))
    assert folder.credentials() == Credentials(Path("/keys"), "actor")


def test_a_run_has_a_door_if_it_listens_for_other_machines(folder):
    folder.cluster_file.write_text('{"endpoint": "unixsock-stream//tmp/a/router", "namespace": "railctl/1"}')
    folder.config_file.write_text(yaml.safe_dump(CONFIG))
    assert folder.door() is None
    listening = {"cluster": CONFIG["cluster"] | {"listen": "tls/0.0.0.0:7447", "keys": "/keys"}}
    folder.config_file.write_text(yaml.safe_dump(CONFIG | listening))
    assert folder.door() == Door("tls/0.0.0.0:7447", "railctl/1", Credentials(Path("/keys"), "host"))


def test_a_file_is_replaced_in_one_step(tmp_path, monkeypatch):
    path = tmp_path / "file.json"
    write_atomically(path, "one")
    before = path.stat().st_ino
    write_atomically(path, "two")
    assert path.read_text() == "two"
    assert path.stat().st_ino != before  # a reader of the old one still reads the old one
    assert [entry.name for entry in tmp_path.iterdir()] == ["file.json"]

    def break_off(*_arguments):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", break_off)
    monkeypatch.setattr(type(path), "replace", break_off)
    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, "three")
    assert path.read_text() == "two"


def test_a_file_that_is_replaced_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    path, synced = tmp_path / "config.yaml", []

    def note(number):
        synced.append((Path(f"/proc/self/fd/{number}").readlink().parent, os.fstat(number).st_size, path.exists()))

    monkeypatch.setattr(os, "fsync", note)
    write_atomically(path, "seed: 1")
    file, folder = synced
    assert file == (tmp_path, 7, False)
    assert folder[0] == tmp_path.parent  # it is the folder itself
    assert folder[2]


@pytest.mark.parametrize(
    "text",
    [
        '{"endpoint": 5, "namespace": "railctl/1", "actors": {"easy": 1}}',
        '{"endpoint": "tcp/127.0.0.1:1", "namespace": ["railctl/1"], "actors": {"easy": 1}}',
        '{"endpoint": "tcp/127.0.0.1:1", "namespace": "railctl/1", "actors": [1]}',
        '{"endpoint": "tcp/127.0.0.1:1", "namespace": "railctl/1", "actors": {"easy": "many"}}',
        '{"endpoint": "tcp/127.0.0.1:1", "namespace": "railctl/1", "actors": {"easy": true}}',
        '{"endpoint": "tcp/127.0.0.1:1", "namespace": "railctl/1", "actors": {"easy": 1}, "more": 1}',
        "[" * 100_000,
        "5",
    ],
)
def test_a_cluster_file_of_another_form_is_as_none(folder, text):
    folder.cluster_file.write_text(text)
    assert folder.cluster() == Cluster()
    assert folder.wants_actors()
    with pytest.raises(NoAnswer, match="has no cluster: start one with railctl up"):
        folder.endpoint_and_namespace()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"outcome": "finished"}',
        '{"outcome": "won", "reason": ""}',
        '{"outcome": [], "reason": 5}',
        "[" * 100_000,
    ],
)
def test_an_outcome_of_another_form_is_none(folder, text):
    folder.outcome_file.write_text(text)
    assert folder.outcome() is None


def test_how_a_run_ended(folder):
    folder.outcome_file.write_text('{"outcome": "failed", "reason": "no disk"}')
    assert folder.outcome() == Outcome(outcome="failed", reason="no disk")
