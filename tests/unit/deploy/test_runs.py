"""Runs are found by name, by folder, or as the newest; a cluster that is not there says so."""

import os
from pathlib import Path

import pytest

from railctl.common.bus import NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.locks import sole
from railctl.common.strict import ConfigError
from railctl.deploy.runs import all_runs, find_run, reach, runs_root, supervised


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


def make(root, name, age_s):
    folder = RunFolder(root / name)
    folder.path.mkdir(parents=True)
    folder.config_file.touch()
    os.utime(folder.config_file, (1000 - age_s, 1000 - age_s))
    return folder


def complaint(name):
    with pytest.raises(ConfigError) as caught:
        find_run(name)
    return str(caught.value)


def test_runs_lie_in_the_working_directory_unless_told_otherwise(monkeypatch):
    monkeypatch.delenv("RAILCTL_RUNS", raising=False)
    assert str(runs_root()) == "runs"
    monkeypatch.setenv("RAILCTL_RUNS", "elsewhere")
    assert str(runs_root()) == "elsewhere"


def test_runs_do_not_lie_where_no_file_of_theirs_could_say(monkeypatch, tmp_path):
    monkeypatch.setenv("RAILCTL_RUNS", "b\udcff")
    with pytest.raises(ConfigError, match=r"^RAILCTL_RUNS b\\udcff: its name is not UTF-8: use another folder$"):
        runs_root()
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path))
    (tmp_path / "b\udcff").mkdir()
    monkeypatch.chdir(tmp_path / "b\udcff")
    with pytest.raises(ConfigError, match=r"^the working directory .*: its name is not UTF-8: use another folder$"):
        runs_root()


def test_who_was_left_in_a_deleted_folder_still_finds_runs(root, monkeypatch, tmp_path):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert runs_root() == root


def test_without_runs_it_says_how_to_start_one(root):
    assert all_runs() == []
    assert complaint(None) == f"there are no runs in {root}: start one with railctl up"
    assert complaint("one") == f"no run named 'one': there are no runs in {root}, start one with railctl up"
    assert not root.exists()


def test_runs_are_in_the_order_of_their_age_and_other_folders_are_none(root):
    make(root, "new", 1)
    make(root, "old", 9)
    (root / "empty").mkdir()
    (root / "file").touch()
    assert [run.path.name for run in all_runs()] == ["old", "new"]


def test_a_run_is_found_by_name_and_by_folder(root, tmp_path):
    ours = make(root, "one", 1)
    elsewhere = make(tmp_path, "two", 1)
    assert find_run("one") == ours
    assert find_run(str(elsewhere.path)) == elsewhere


def test_an_unknown_run_names_the_nearest(root):
    make(root, "easy-1", 1)
    make(root, "hard-1", 1)
    assert complaint("esy-1") == "no run named 'esy-1': did you mean easy-1? known are easy-1, hard-1"


def test_without_a_name_it_is_the_newest_living_one_or_else_the_newest(root):
    oldest, middle, newest = (make(root, name, age) for name, age in (("a", 9), ("b", 5), ("c", 1)))
    assert find_run(None) == newest
    with sole(oldest, "learner"):
        assert find_run(None) == oldest
        with sole(middle, "actor-easy-0"):
            assert find_run(None) == middle
    assert find_run(None) == newest


def test_a_run_is_supervised_while_its_supervisor_lives(root):
    run = make(root, "one", 1)
    with sole(run, "learner"):
        assert not supervised(run)
        with sole(run, "supervisor"):
            assert supervised(run)
    assert not supervised(run)


def test_a_run_that_is_not_there_is_not_reached(root, monkeypatch):
    run = make(root, "one", 1)
    with pytest.raises(NoAnswer, match="run one has no cluster: start one with railctl up"), reach(run):
        pass
    run.cluster_file.write_text('{"endpoint": "tcp/127.0.0.1:9", "namespace": "x"}')
    with pytest.raises(NoAnswer, match="run one is not running: railctl up --name one resumes it"), reach(run):
        pass
    run.outcome_file.write_text('{"outcome": "finished", "reason": ""}')
    with pytest.raises(NoAnswer, match="run one is finished: start another one with railctl up"), reach(run):
        pass
    monkeypatch.setattr("railctl.deploy.runs.CONNECT_TIMEOUT_S", 0.1)
    with sole(run, "learner"), pytest.raises(NoAnswer, match=r"no router at tcp/127\.0\.0\.1:9"), reach(run):
        pass


def test_another_users_run_is_named_as_such_and_not_listed(root, monkeypatch):
    run = make(root, "one", 1)
    make(root, "two", 2)

    def exists(path):
        if path.parent == run.path:
            raise PermissionError
        return path.is_file()

    monkeypatch.setattr(Path, "exists", exists)
    monkeypatch.setattr("os.access", lambda path, _mode: path != run.path)
    assert [found.path.name for found in all_runs()] == ["two"]
    with pytest.raises(ConfigError, match=f"{run.path} belongs to {run.path.owner()}, and nobody else may look"):
        find_run("one")
