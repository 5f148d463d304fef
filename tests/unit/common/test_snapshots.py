"""The snapshot that a run goes on from is the newest one, and a damaged one says what deleting it leads to."""

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
    tensors, metadata = newest_snapshot(folder)
    assert tensors["w"].tolist() == [100, 100, 100]
    assert metadata["episode"] == "100"


def test_what_is_only_half_written_does_not_count(folder):
    save(folder, 5)
    (folder.snapshots / ".00000009.safetensors.77.tmp").write_bytes(b"half")
    assert newest_snapshot(folder)[1]["episode"] == "5"


@pytest.mark.parametrize(("others", "then"), [((), "from the start"), ((3, 4), "from 00000004.safetensors")])
def test_a_damaged_one_says_what_deleting_it_leads_to(folder, others, then):
    for episode in others:
        save(folder, episode)
    path = save(folder, 5)
    path.write_bytes(path.read_bytes()[:-1] + b"\xff")
    with pytest.raises(CheckpointError) as caught:
        newest_snapshot(folder)
    text = str(caught.value)
    assert text.startswith(f"{path}: damaged")
    assert text.endswith(f", or delete it to go on {then}, to the same curve")
    path.unlink()
    assert (newest_snapshot(folder) is None) is (not others)
