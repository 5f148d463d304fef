"""Runs that begin with the network of a checkpoint: what is found of the file, what is refused, and the copy."""

import pytest
import yaml

from railctl.common.checkpoint import load
from railctl.common.rules.settings import NetworkConfig
from railctl.common.strict import ConfigError
from railctl.deploy.launch import new_run
from railctl.deploy.resolve import resolve, resolve_existing
from railctl.deploy.runs import Failed

NETWORK = NetworkConfig(kind="actor-critic")


@pytest.fixture
def file(write_checkpoint, tmp_path):
    return write_checkpoint(tmp_path / "first.safetensors", NETWORK)


def given(**more):
    return {"algorithm": "ppo", "level": "easy", "start_from": "first.safetensors", "cluster": {"cores": 1}} | more


@pytest.mark.parametrize("algorithm", ["ppo", "ppor", "sil"])
def test_its_digest_is_of_the_science(file, tmp_path, algorithm):
    config = resolve(given(algorithm=algorithm), tmp_path)
    digest = load(file, "checkpoint")[1]["digest"]
    assert config.science["start_from"] == {"digest": digest}  # wherever it lies


def test_what_a_run_came_to_is_a_run_file(file, tmp_path):
    config = resolve(given(), tmp_path)
    assert resolve(yaml.safe_load(yaml.safe_dump(config.plain())), tmp_path) == config
    without = resolve(given(start_from=None), tmp_path)
    assert resolve(yaml.safe_load(yaml.safe_dump(without.plain())), tmp_path) == without
    assert without.learning.begins_with is None


def test_a_run_keeps_a_copy_and_goes_on_without_the_file(file, tmp_path):
    config = resolve(given(), tmp_path)
    folder = new_run("some", config, tmp_path / "runs", base=tmp_path)
    before = file.read_bytes()
    file.unlink()
    assert folder.start_file.read_bytes() == before
    assert resolve_existing(folder.config(), given(), "some", tmp_path) == folder.config()
    assert folder.config().science == config.science


def test_the_configuration_of_a_run_is_a_run_file_beside_its_copy(file, tmp_path):
    folder = new_run("some", resolve(given(), tmp_path), tmp_path / "runs", base=tmp_path)
    file.unlink()
    assert resolve(yaml.safe_load(folder.config_file.read_text()), folder.path) == folder.config()


def test_a_run_does_not_go_on_from_another(file, tmp_path, write_checkpoint):
    folder = new_run("some", resolve(given(), tmp_path), tmp_path / "runs", base=tmp_path)
    write_checkpoint(file, NETWORK, seed=5)
    with pytest.raises(ConfigError, match=r"run some exists with start_from of digest [0-9a-f]{32}, not first"):
        resolve_existing(folder.config(), given(), "some", tmp_path)
    with pytest.raises(ConfigError, match=r"run some exists with start_from\.digest [0-9a-f]{32}, not 0000"):
        resolve_existing(folder.config(), given(start_from={"digest": "0" * 32}), "some")


def test_a_file_that_changed_meanwhile_is_not_taken(file, tmp_path, write_checkpoint):
    config = resolve(given(), tmp_path)
    write_checkpoint(file, NETWORK, seed=5)
    with pytest.raises(Failed, match=r"first\.safetensors has changed while the run was made"):
        new_run("some", config, tmp_path / "runs", base=tmp_path)
    assert list((tmp_path / "runs").iterdir()) == []


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"start_from": "none.safetensors"}, "no such file"),
        ({"network": {"hidden": [64]}}, "its network is actor-critic [128, 128], that of the run actor-critic [64]"),
        ({"observation": "global"}, "its trains see 252 features (tree), those of the run"),
        ({"start_from": {"checkpoint": "first.safetensors", "digest": "0" * 32}}, "is not the file of"),
        ({"start_from": "values.safetensors"}, "its network is dueling [128, 128]"),
        ({"algorithm": "dqn"}, "start_from: rule dqn has no use for it, leave it out"),
        ({"start_from": 3}, "start_from: input should be a valid dictionary, not 3"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(file, tmp_path, write_checkpoint, more, text):
    write_checkpoint(tmp_path / "values.safetensors")
    with pytest.raises(ConfigError) as caught:
        resolve(given(**more), tmp_path)
    assert text in str(caught.value)
    assert str(caught.value).startswith("start_from")
