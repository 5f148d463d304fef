"""What the learner keeps on disk: rows, snapshots to go on from, checkpoints to evaluate."""

import json
import logging
import platform
from collections.abc import Callable
from pathlib import Path

import numpy as np

from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError, Metadata, Tensors
from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder, numbered
from railctl.common.machine import processor
from railctl.common.policy.flat import Arrays
from railctl.common.process import Fatal
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import DamagedRows, RowFile
from railctl.common.snapshots import check_history, episodes_of, newest_snapshot

log = logging.getLogger(__name__)

KEPT_SNAPSHOTS = 2


class Archive:
    """The learner's files. Rows are on disk before the snapshot that counts on them."""

    def __init__(self, folder: RunFolder, config: RunConfig, on_row: Callable[[], object] = lambda: None) -> None:
        """`on_row` is that of `RowFile`."""
        self._folder = folder
        self._config = config
        self._science = json.dumps(config.science, sort_keys=True)
        self._algorithm = config.algorithm
        self._expected: dict[int, str] = {}
        folder.checkpoints.mkdir(exist_ok=True)
        folder.snapshots.mkdir(exist_ok=True)
        for kept in (folder.checkpoints, folder.snapshots):
            for half_written in kept.glob(".*.tmp"):  # by a learner that was killed
                half_written.unlink()
        try:
            self.rows = RowFile(folder.episodes_file, EpisodeRow, on_row)
        except DamagedRows as error:
            raise Fatal(str(error)) from None
        self.snapshot = 0  # episodes in the newest snapshot
        self.version = 0  # of the weights in it
        self.exact_until: int | None = None  # set when a snapshot comes from another arithmetic

    def resume(self) -> Tensors | None:
        """The newest snapshot that can be read, None at the start; later rows are set aside for comparison.

        Raises:
            Fatal: all snapshots are damaged, or it belongs to another configuration, or rows are missing.
        """
        tensors: Tensors | None = None
        try:
            newest = newest_snapshot(self._folder, self._config)
            if newest is not None:
                tensors, metadata, damaged = newest
                for path in damaged:
                    log.warning("%s is damaged and set aside: the run goes on from the one before", path)
                    path.rename(path.with_suffix(".damaged"))
                check_history(self._folder.episodes_file, self.rows.read(), metadata)
                self._take_up(metadata)
        except CheckpointError as error:
            raise Fatal(str(error)) from None
        self._expected = {row.episode: row.digest for row in self.rows.cut(self.snapshot)}
        return tensors

    def _take_up(self, metadata: Metadata) -> None:
        self.snapshot = episodes_of(metadata)
        self.version = int(metadata.get("weights_version", "0"))
        if not repeats(metadata.get("arithmetic", ""), with_torch=self._config.learning.learns_with_torch):
            self.exact_until = self.snapshot
            log.warning("exactness ends at episode %d: snapshot %s", self.snapshot, metadata.get("arithmetic"))

    def close(self) -> None:
        """Close the row file."""
        self.rows.close()

    def append(self, row: EpisodeRow) -> None:
        """Write the row of a trained episode; after a restart it is what it was before, but in a free run."""
        before = self._expected.pop(row.episode, row.digest)
        if before != row.digest and not self._config.is_free:
            log.error("episode %d is not what it was before the restart: %s, then %s", row.episode, before, row.digest)
        self.rows.append(row)

    def save_snapshot(self, state: Tensors, episode: int, version: int, kept: int = KEPT_SNAPSHOTS) -> None:
        """Write everything that training goes on from, and keep the last few."""
        self.rows.sync()
        checkpoint.save(_file(self._folder.snapshots, episode), state, self._metadata(episode, version), "snapshot")
        self.snapshot, self.version = episode, version
        for old in numbered(self._folder.snapshots)[:-kept]:
            old.unlink()

    def save_checkpoint(self, weights: Arrays, episode: int, version: int) -> Path:
        """Write what acts and is evaluated."""
        path = _file(self._folder.checkpoints, episode)
        checkpoint.save(path, weights, self._metadata(episode, version), "checkpoint")
        return path

    def checkpoint_content(self, episode: int) -> bytes | None:
        """A checkpoint's bytes; None: there is no such checkpoint."""
        path = _file(self._folder.checkpoints, episode)
        return path.read_bytes() if path.exists() else None

    def checkpoints(self, trained: int) -> list[int]:
        """The checkpoints up to `trained` episodes, in order."""
        stems = [path.stem for path in self._folder.checkpoints.glob("*.safetensors")]
        found = sorted(int(stem) for stem in stems if stem.isdecimal())  # a user may keep others beside ours
        return [episode for episode in found if episode <= trained]

    def _metadata(self, episode: int, version: int) -> dict[str, str]:
        return {
            "algorithm": self._algorithm,
            "episode": str(episode),
            "weights_version": str(version),
            "science": self._science,
            "arithmetic": arithmetic(with_torch=self._config.learning.learns_with_torch),
        }


def repeats(there: str, *, with_torch: bool) -> bool:
    """Whether what was begun with the `arithmetic` of another process goes on here with the same bits."""
    return there == arithmetic(with_torch=True) if with_torch else f'"machine": "{platform.machine()}"' in there


def arithmetic(*, with_torch: bool) -> str:
    """What bits depend on: the machine those of compiled code, all of it those of torch."""
    told = {"machine": platform.machine(), "numpy": np.__version__, "processor": processor()}
    if with_torch:
        import torch  # noqa: PLC0415  (it takes seconds)

        told |= {"torch": torch.__version__, "kernels": torch.backends.cpu.get_cpu_capability()}
    return json.dumps(told, sort_keys=True)


def _file(folder: Path, episode: int) -> Path:
    return folder / f"{episode:08d}.safetensors"
