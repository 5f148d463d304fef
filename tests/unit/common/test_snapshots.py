"""The snapshot that a run goes on from is the newest one, and the one before where that is damaged."""

import numpy as np
import pytest

from common import checkpoint
from common.checkpoint import CheckpointError
from common.folder import RunFolder
from common.snapshots import newest_snapshot


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "snapshots").mkdir()
    return RunFolder(tmp_path)


def save(folder, episode):
    path = folder.snapshots / f"{episode:08d}.safetensors"
    checkpoint.save(path, {"w": np.full(3, episode, np.float32)}, {"episode": str(episode)}, "snapshot")
    return path


def test_before_the_first_there_is_none(folder, tmp_path):
    assert newest_snapshot(folder) is None
    assert newest_snapshot(RunFolder(tmp_path / "nowhere")) is None


def test_the_newest_is_the_one_of_most_episodes_whenever_it_was_written(folder):
    for episode in (100, 9, 20):
        save(folder, episode)
    tensors, metadata, damaged = newest_snapshot(folder)
    assert tensors["w"].tolist() == [100, 100, 100]
    assert (metadata["episode"], damaged) == ("100", [])


def test_what_is_only_half_written_does_not_count(folder):
    save(folder, 5)
    (folder.snapshots / ".00000009.safetensors.77.tmp").write_bytes(b"half")
    assert newest_snapshot(folder)[1]["episode"] == "5"


def damage(path):
    path.write_bytes(path.read_bytes()[:-1] + b"\xff")
    return path


def test_the_one_before_takes_the_place_of_a_damaged_one(folder):
    save(folder, 3)
    save(folder, 4)
    damaged = [damage(save(folder, 6)), damage(save(folder, 5))]
    found = newest_snapshot(folder)
    assert found.metadata["episode"] == "4"
    assert found.damaged == damaged


@pytest.mark.parametrize(("episodes", "deleted"), [((5,), "it"), ((4, 5), "all 2 of {}")])
def test_where_all_are_damaged_the_newest_is_named_and_the_way_out(folder, episodes, deleted):
    paths = [damage(save(folder, episode)) for episode in episodes]
    with pytest.raises(CheckpointError) as caught:
        newest_snapshot(folder)
    assert str(caught.value).startswith(f"{paths[-1]}: damaged")
    deleted = deleted.format(folder.snapshots)
    assert str(caught.value).endswith(f", or delete {deleted} to go on from the start, to the same curve")
