"""What the learner keeps on disk: it goes on from the newest snapshot, or says clearly why it cannot."""

import json
import logging
import os
from pathlib import Path

import numpy as np
import pytest
from made_rows import episode_row

from railctl.common import checkpoint
from railctl.common.config import parse_config
from railctl.common.folder import RunFolder
from railctl.common.process import Fatal
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import RowFile, read_rows
from railctl.services.learner import archive as archive_module
from railctl.services.learner.archive import Archive, arithmetic, repeats


def config(**changes):
    return parse_config(
        {
            "algorithm": "dddqn",
            "mix": {"easy": 1.0},
            "episodes": 20,
            "network": {},
            "dqn": {"learning_rate": 0.001, "batch_size": 8, "learn_every_steps": 4},
            "replay": {"capacity": 100},
            "rule": "dqn",
            "cluster": {"actors": {"easy": 1}},
        }
        | changes
    )


def row(number, digest=None):
    return episode_row(number, seed=number, digest=digest or f"{number:032x}")


def state(number):
    return {"trainer/episodes": np.array(number, np.int64), "weights": np.full(3, number, np.float32)}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A run's folder; its row files are closed at the end, as by the end of a process."""
    opened = []

    def open_rows(*arguments):
        opened.append(RowFile(*arguments))
        return opened[-1]

    monkeypatch.setattr(archive_module, "RowFile", open_rows)
    yield RunFolder(tmp_path)
    for file in opened:
        file.close()


def trained(folder, rows, snapshots=()):
    """The folder of a learner that trained `rows` episodes and was killed."""
    archive = Archive(folder, config())
    archive.resume()
    for number in range(rows):
        archive.append(row(number))
        if number + 1 in snapshots:
            archive.save_snapshot(state(number + 1), number + 1, 3 * number + 3)
    return archive


def fatal(folder, settings=None):
    with pytest.raises(Fatal) as caught:
        Archive(folder, settings or config()).resume()
    text = str(caught.value)
    assert "\n" not in text
    return text


def snapshots(folder):
    return sorted(path.name for path in folder.snapshots.iterdir())


def test_a_new_run_starts_from_nothing(folder):
    archive = Archive(folder, config())
    assert archive.resume() is None
    assert (archive.rows.count, archive.snapshot, archive.exact_until) == (0, 0, None)
    assert archive.checkpoints(20) == []


def test_rows_beyond_the_newest_snapshot_are_cut_and_trained_again(folder):
    trained(folder, 7, snapshots=(3, 5))
    archive = Archive(folder, config())
    tensors = archive.resume()
    assert tensors["trainer/episodes"] == 5
    assert tensors["weights"].tolist() == [5, 5, 5]
    assert archive.snapshot == 5
    assert list(archive.rows.read()) == read_rows(folder.episodes_file, EpisodeRow) == [row(n) for n in range(5)]
    archive.append(row(5))
    assert read_rows(folder.episodes_file, EpisodeRow) == [row(n) for n in range(6)]


def test_without_a_snapshot_all_rows_are_cut(folder):
    trained(folder, 3)
    archive = Archive(folder, config())
    assert archive.resume() is None
    assert list(archive.rows.read()) == read_rows(folder.episodes_file, EpisodeRow) == []


def test_a_replay_that_repeats_is_silent(folder, caplog):
    trained(folder, 7, snapshots=(5,))
    archive = Archive(folder, config())
    archive.resume()
    for number in range(5, 9):
        archive.append(row(number))
    assert caplog.records == []


def test_a_replay_that_does_not_repeat_is_an_error_in_the_log(folder, caplog):
    trained(folder, 7, snapshots=(5,))
    archive = Archive(folder, config())
    archive.resume()
    archive.append(row(5))
    archive.append(row(6, digest="f" * 32))
    [record] = caplog.records
    assert record.levelno == logging.ERROR
    assert record.getMessage() == (f"episode 6 is not what it was before the restart: {6:032x}, then {'f' * 32}")


@pytest.mark.parametrize("change", [{"seed": 2}, {"lag": 1}, {"episodes": 21}, {"discount": 0.9}])
def test_a_snapshot_of_another_configuration_is_not_gone_on_from(folder, change):
    trained(folder, 5, snapshots=(5,))
    assert fatal(folder, config(**change)) == (
        "the newest snapshot has another configuration: restore config.yaml or use a new run name"
    )
    assert len(read_rows(folder.episodes_file, EpisodeRow)) == 5  # nothing was cut


def test_another_cluster_makes_no_difference(folder):
    trained(folder, 5, snapshots=(5,))
    archive = Archive(folder, config(cluster={"actors": {"any": 9}, "snapshot_every_episodes": 3}))
    assert archive.resume() is not None
    assert archive.snapshot == 5


def test_a_damaged_snapshot_is_set_aside_for_the_one_before(folder, caplog):
    trained(folder, 7, snapshots=(3, 5))
    path = folder.snapshots / "00000005.safetensors"
    path.write_bytes(path.read_bytes()[:-1])
    archive = Archive(folder, config())
    assert archive.resume()["trainer/episodes"] == 3
    assert (archive.snapshot, archive.rows.count) == (3, 3)
    assert caplog.messages == [f"{path} is damaged and set aside: the run goes on from the one before"]
    assert snapshots(folder) == ["00000003.safetensors", "00000005.damaged"]


def test_a_damaged_snapshot_that_is_the_only_one_is_fatal_and_named(folder):
    trained(folder, 5, snapshots=(5,))
    path = folder.snapshots / "00000005.safetensors"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    assert fatal(folder).startswith(f"{path}: damaged")
    path.write_bytes(data[: len(data) // 2])
    assert fatal(folder).startswith(f"{path}: not a safetensors file")
    assert len(read_rows(folder.episodes_file, EpisodeRow)) == 5


def test_a_checkpoint_is_no_snapshot(folder):
    archive = trained(folder, 5)
    archive.save_checkpoint(state(5), 5, 9).rename(folder.snapshots / "00000005.safetensors")
    assert "is a 'checkpoint', not a snapshot" in fatal(folder)


def test_missing_rows_are_fatal(folder):
    trained(folder, 5, snapshots=(5,))
    lines = folder.episodes_file.read_bytes().splitlines(keepends=True)
    folder.episodes_file.write_bytes(b"".join(lines[:4]) + lines[4][:10])
    assert fatal(folder) == (
        f"{folder.episodes_file} does not hold the 5 episodes of the newest snapshot: "
        "restore the file, or delete snapshots that are newer than its last good row"
    )


def test_the_advice_about_missing_rows_helps(folder):
    trained(folder, 5, snapshots=(3, 5))
    lines = folder.episodes_file.read_bytes().splitlines(keepends=True)
    folder.episodes_file.write_bytes(b"".join(lines[:4]))
    fatal(folder)
    (folder.snapshots / "00000005.safetensors").unlink()
    archive = Archive(folder, config())
    assert archive.resume()["trainer/episodes"] == 3
    assert archive.rows.count == 3


def test_damaged_rows_are_fatal(folder):
    trained(folder, 3)
    lines = folder.episodes_file.read_bytes().splitlines(keepends=True)
    folder.episodes_file.write_bytes(lines[0] + b"nonsense\n" + lines[2])
    assert fatal(folder).startswith(f"{folder.episodes_file} line 2 is not a valid row")


def test_two_snapshots_are_kept(folder):
    trained(folder, 6, snapshots=(1, 2, 4, 6))
    assert snapshots(folder) == ["00000004.safetensors", "00000006.safetensors"]


def test_fewer_snapshots_may_be_kept(folder):
    archive = trained(folder, 6, snapshots=(2, 4))
    archive.save_snapshot(state(6), 6, 6, kept=1)
    assert snapshots(folder) == ["00000006.safetensors"]


def test_a_strange_file_among_the_snapshots_stays_and_counts_for_none(folder):
    archive = trained(folder, 6, snapshots=(2,))
    (folder.snapshots / "best.safetensors").write_bytes(b"theirs")
    archive.save_snapshot(state(4), 4, 4)
    archive.save_snapshot(state(6), 6, 6)
    assert snapshots(folder) == ["00000004.safetensors", "00000006.safetensors", "best.safetensors"]


def test_a_snapshot_counts_on_rows_that_are_on_disk(folder, monkeypatch):
    archive = trained(folder, 3)
    order = []
    fsync, save = os.fsync, checkpoint.save

    def note(number):
        order.append(str(Path(f"/proc/self/fd/{number}").readlink()))
        fsync(number)

    monkeypatch.setattr(os, "fsync", note)
    monkeypatch.setattr(checkpoint, "save", lambda *arguments: (order.append("snapshot"), save(*arguments)))
    archive.save_snapshot(state(3), 3, 3)
    assert order[:2] == [str(folder.episodes_file), "snapshot"]
    assert archive.snapshot == 3


def test_a_snapshot_that_fails_leaves_the_one_before(folder, monkeypatch):
    archive = trained(folder, 4, snapshots=(2,))

    def disk_full(*_arguments):
        raise OSError("disk full")

    monkeypatch.setattr(checkpoint, "save", disk_full)
    with pytest.raises(OSError, match="disk full"):
        archive.save_snapshot(state(4), 4, 4)
    assert archive.snapshot == 2
    assert snapshots(folder) == ["00000002.safetensors"]


def test_what_a_killed_learner_left_half_written_goes(folder):
    trained(folder, 2, snapshots=(2,))
    (folder.snapshots / ".00000004.safetensors.99.tmp").write_bytes(b"half")
    (folder.checkpoints / ".00000004.safetensors.99.tmp").write_bytes(b"half")
    assert Archive(folder, config()).resume()["trainer/episodes"] == 2
    assert snapshots(folder) == ["00000002.safetensors"]
    assert list(folder.checkpoints.iterdir()) == []


def test_another_machine_ends_exactness_and_says_where(folder, monkeypatch, caplog):
    trained(folder, 5, snapshots=(5,))
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(archive_module.platform, "machine", lambda: "riscv64")
        archive = Archive(folder, config())
        assert archive.resume() is not None
    assert archive.exact_until == 5
    assert caplog.records[0].getMessage().startswith("exactness ends at episode 5: ")
    caplog.clear()
    same = Archive(folder, config())
    same.resume()
    assert same.exact_until is None
    assert caplog.records == []


def test_another_processor_ends_exactness_only_where_torch_learns(monkeypatch):
    here = arithmetic(with_torch=True)
    monkeypatch.setattr(archive_module, "processor", lambda: "another processor")
    assert repeats(here, with_torch=False)
    assert not repeats(here, with_torch=True)
    assert repeats(arithmetic(with_torch=True), with_torch=True)
    assert not repeats("", with_torch=False)


def test_arithmetic_names_what_bits_depend_on():
    compiled, torch = (json.loads(arithmetic(with_torch=with_torch)) for with_torch in (False, True))
    assert set(compiled) == {"numpy", "processor", "machine"}
    assert set(torch) == {*compiled, "torch", "kernels"}
    assert all(torch.values())


def test_checkpoints_are_listed_up_to_what_is_trained_and_come_byte_for_byte(folder):
    archive = trained(folder, 0)
    assert archive.checkpoint_content(10) is None
    for episode in (10, 5, 20):
        weights = {"weights": np.full(3, episode, np.float32)}
        path = archive.save_checkpoint(weights, episode, 7 * episode)
        assert archive.checkpoint_content(episode) == path.read_bytes()
    assert archive.checkpoints(20) == [5, 10, 20]
    assert archive.checkpoints(19) == [5, 10]
    assert archive.checkpoints(0) == []
    tensors, metadata = checkpoint.load(path, "checkpoint")
    assert tensors["weights"].tolist() == [20, 20, 20]
    assert (metadata["algorithm"], metadata["episode"], metadata["weights_version"]) == ("dddqn", "20", "140")
    assert json.loads(metadata["science"]) == config().science


def test_a_strange_file_among_the_checkpoints_does_no_harm(folder):
    archive = trained(folder, 0)
    archive.save_checkpoint(state(5), 5, 9)
    (folder.checkpoints / "best.safetensors").write_bytes(archive.checkpoint_content(5))
    assert archive.checkpoints(20) == [5]


def test_rows_that_are_not_those_of_the_snapshot_are_fatal(folder):
    trained(folder, 6, snapshots=(5,))
    lines = folder.episodes_file.read_bytes().splitlines(keepends=True)
    folder.episodes_file.write_bytes(b"".join(lines[:2] + lines[3:]))  # five rows, but not the first five
    assert str(folder.episodes_file) in fatal(folder)
