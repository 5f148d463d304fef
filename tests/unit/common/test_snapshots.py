"""The snapshot that a run goes on from is the newest one, and the one before where that is damaged."""

import json

import numpy as np
import pytest

from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError
from railctl.common.config import parse_config
from railctl.common.folder import RunFolder
from railctl.common.snapshots import newest_snapshot

CONFIG = parse_config(
    {
        "algorithm": "dqn",
        "rule": "dqn",
        "mix": {"easy": 1.0},
        "episodes": 20,
        "network": {},
        "dqn": {"learning_rate": 0.001, "batch_size": 8, "learn_every_steps": 4},
        "replay": {"capacity": 100},
        "cluster": {"actors": {"easy": 1}},
    }
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "snapshots").mkdir()
    return RunFolder(tmp_path)


def save(folder, episode):
    path = folder.snapshots / f"{episode:08d}.safetensors"
    checkpoint.save(
        path,
        {"w": np.full(3, episode, np.float32)},
        {"episode": str(episode), "science": json.dumps(CONFIG.science)},
        "snapshot",
    )
    return path


def test_before_the_first_there_is_none(folder, tmp_path):
    assert newest_snapshot(folder, CONFIG) is None
    assert newest_snapshot(RunFolder(tmp_path / "nowhere"), CONFIG) is None


def test_the_newest_is_the_one_of_most_episodes_whenever_it_was_written(folder):
    for episode in (100, 9, 20):
        save(folder, episode)
    tensors, metadata, damaged = newest_snapshot(folder, CONFIG)
    assert tensors["w"].tolist() == [100, 100, 100]
    assert (metadata["episode"], damaged) == ("100", [])


def test_what_is_only_half_written_does_not_count(folder):
    save(folder, 5)
    (folder.snapshots / ".00000009.safetensors.77.tmp").write_bytes(b"half")
    assert newest_snapshot(folder, CONFIG)[1]["episode"] == "5"


def test_what_a_user_keeps_beside_them_is_never_the_newest(folder):
    save(folder, 5).rename(folder.snapshots / "best.safetensors")
    assert newest_snapshot(folder, CONFIG) is None
    save(folder, 3)
    assert newest_snapshot(folder, CONFIG)[1]["episode"] == "3"


def damage(path):
    path.write_bytes(path.read_bytes()[:-1] + b"\xff")
    return path


def test_the_one_before_takes_the_place_of_a_damaged_one(folder):
    save(folder, 3)
    save(folder, 4)
    damaged = [damage(save(folder, 6)), damage(save(folder, 5))]
    found = newest_snapshot(folder, CONFIG)
    assert found.metadata["episode"] == "4"
    assert found.damaged == damaged


@pytest.mark.parametrize(("episodes", "deleted"), [((5,), "it"), ((4, 5), "all 2 of {}")])
def test_where_all_are_damaged_the_newest_is_named_and_the_way_out(folder, episodes, deleted):
    paths = [damage(save(folder, episode)) for episode in episodes]
    with pytest.raises(CheckpointError) as caught:
        newest_snapshot(folder, CONFIG)
    assert str(caught.value).startswith(f"{paths[-1]}: damaged")
    deleted = deleted.format(folder.snapshots)
    assert str(caught.value).endswith(f", or delete {deleted} to go on from the start, to the same curve")


def test_one_of_another_configuration_is_not_gone_on_from(folder):
    save(folder, 5)
    with pytest.raises(CheckpointError, match=r"^the newest snapshot has another configuration: restore config\.yaml"):
        newest_snapshot(folder, CONFIG.model_copy(update={"seed": CONFIG.seed + 1}))
