"""Runs whose replay begins with demonstrations: what is found of the file, what is refused, and the copy."""

import pytest
import yaml
from demonstrated import WORLD, course

from railctl.common.demonstrations import digest_of_file, write_demonstrations
from railctl.common.strict import ConfigError
from railctl.deploy.launch import new_run
from railctl.deploy.resolve import resolve, resolve_existing
from railctl.deploy.runs import Failed


@pytest.fixture
def file(tmp_path):
    write_demonstrations(tmp_path / "some.demos", WORLD, "somebody", 2, map(course, range(2)))
    return tmp_path / "some.demos"


def given(**more):
    return {"algorithm": "sil", "level": "easy", "demonstrations": "some.demos", "cluster": {"cores": 1}} | more


def test_its_digest_is_of_the_science(file, tmp_path):
    config = resolve(given(), tmp_path)
    assert config.science["demonstrations"] == {"digest": digest_of_file(file)}  # wherever it lies
    assert resolve(yaml.safe_load(yaml.safe_dump(config.plain())), tmp_path) == config


def test_a_run_keeps_a_copy_and_goes_on_without_the_file(file, tmp_path):
    config = resolve(given(), tmp_path)
    folder = new_run("some", config, tmp_path / "runs", base=tmp_path)
    before = file.read_bytes()
    file.unlink()
    assert folder.demonstrations_file.read_bytes() == before
    assert resolve_existing(folder.config(), given(), "some", tmp_path) == folder.config()
    assert resolve(yaml.safe_load(folder.config_file.read_text()), folder.path) == folder.config()


def test_a_run_does_not_go_on_with_others(file, tmp_path):
    folder = new_run("some", resolve(given(), tmp_path), tmp_path / "runs", base=tmp_path)
    file.unlink()
    write_demonstrations(file, WORLD, "somebody", 1, [course()])
    with pytest.raises(ConfigError, match=r"run some exists with demonstrations of digest [0-9a-f]{32}, not some"):
        resolve_existing(folder.config(), given(), "some", tmp_path)


def test_a_file_that_changed_meanwhile_is_not_taken(file, tmp_path):
    config = resolve(given(), tmp_path)
    file.unlink()
    write_demonstrations(file, WORLD, "somebody", 1, [course()])
    with pytest.raises(Failed, match=r"some\.demos has changed while the run was made"):
        new_run("some", config, tmp_path / "runs", base=tmp_path)
    assert list((tmp_path / "runs").iterdir()) == []


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"demonstrations": "none.demos"}, "No such file or directory"),
        ({"demonstrations": "other.txt"}, "other.txt: no demonstrations: give a file of railctl demonstrate"),
        ({"interlocking": "planned"}, "some.demos: was played in another world: make it with railctl demonstrate"),
        ({"level": "hard"}, "some.demos: was played in another world"),
        ({"demonstrations": {"file": "some.demos", "digest": "0" * 32}}, "is not the file of demonstrations.digest"),
        ({"replay": {"capacity": 3}, "sil": {"batch_size": 2}}, "has 4 decisions, replay.capacity is 3"),
        ({"algorithm": "ppo"}, "demonstrations: rule ppo has no use for it, leave it out"),
        ({"demonstrations": 3}, "demonstrations: input should be a valid dictionary, not 3"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(file, tmp_path, more, text):
    (tmp_path / "other.txt").write_text("something else")
    with pytest.raises(ConfigError) as caught:
        resolve(given(**more), tmp_path)
    assert text in str(caught.value)
    assert str(caught.value).startswith("demonstrations")
