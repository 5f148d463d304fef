"""The network that a run begins with."""

import numpy as np
import pytest

from railctl.common.checkpoint import CheckpointError
from railctl.common.rules.settings import NetworkConfig
from railctl.deploy.launch import new_run
from railctl.deploy.resolve import resolve
from railctl.services.learner.learning import build_trainer, learning_of
from railctl.services.learner.start import start_of


@pytest.fixture
def folder(write_checkpoint, tmp_path):
    """That of a run which begins with a checkpoint."""
    write_checkpoint(tmp_path / "first.safetensors", NetworkConfig(kind="actor-critic"))
    plain = {"algorithm": "sil", "level": "easy", "start_from": "first.safetensors", "cluster": {"cores": 1}}
    return new_run("some", resolve(plain, tmp_path), tmp_path / "runs", base=tmp_path)


@pytest.mark.parametrize("algorithm", ["ppo", "ppor", "sil"])
def test_it_is_that_of_the_checkpoint_to_the_bit(folder, algorithm):
    config = folder.config()
    start = start_of(folder, config)
    learning = learning_of(resolve({"algorithm": algorithm, "level": "easy"}), start)
    weights = build_trainer(algorithm, learning).weights()
    assert weights.keys() == start.keys()
    for name, array in start.items():
        np.testing.assert_array_equal(weights[name], array)


def test_without_a_checkpoint_the_seed_makes_it(folder):
    config = resolve({"algorithm": "ppo", "level": "easy"})
    assert start_of(folder, config) is None


def test_another_copy_is_refused(folder, write_checkpoint):
    write_checkpoint(folder.start_file, NetworkConfig(kind="actor-critic"), seed=5)
    with pytest.raises(ValueError, match="is not the checkpoint that the run began with: restore it"):
        start_of(folder, folder.config())
    folder.start_file.unlink()
    with pytest.raises(CheckpointError, match="no such file"):
        start_of(folder, folder.config())


def test_a_tensor_that_does_not_fit_is_named(folder):
    start = start_of(folder, folder.config())
    del start["critic.bias"]
    learning = learning_of(folder.config(), start)
    with pytest.raises(ValueError, match=r"tensor critic\.bias is missing"):
        build_trainer("sil", learning)
