"""Finding the snapshot that a run goes on from, and seeing that it is this run's and its rows are there."""

from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from common import checkpoint
from common.checkpoint import CheckpointError, Metadata, Tensors
from common.config import RunConfig, config_of_science
from common.folder import RunFolder
from common.records.rows import EpisodeRow
from common.strict import ConfigError


def newest_snapshot(folder: RunFolder, config: RunConfig) -> tuple[Tensors, Metadata] | None:
    """The content of a run's newest snapshot, or none before the first.

    Raises:
        CheckpointError: it is damaged, and the text names it and what deleting it leads to; or it belongs to another
            configuration.
    """
    paths = sorted(folder.snapshots.glob("*.safetensors"))
    if not paths:
        return None
    try:
        tensors, metadata = checkpoint.load(paths[-1], "snapshot")
    except CheckpointError as error:
        before = f"from {paths[-2].name}" if len(paths) > 1 else "from the start"
        raise CheckpointError(f"{error}, or delete it to go on {before}, to the same curve") from None
    if not _is_of(config, metadata.get("science", "")):
        raise CheckpointError(
            "the newest snapshot has another configuration: restore config.yaml or use a new run name"
        )
    return tensors, metadata


def check_history(path: Path, rows: Iterable[EpisodeRow], metadata: Metadata) -> None:
    """Raises CheckpointError if a run's rows, those of the file `path`, do not begin with a snapshot's episodes."""
    episodes = episodes_of(metadata)
    found = 0
    for row in islice(rows, episodes):
        found += row.episode == found
    if found < episodes:
        raise CheckpointError(
            f"{path} does not hold the {episodes} episodes of the newest snapshot: "
            "restore the file, or delete snapshots that are newer than its last good row"
        )


def episodes_of(metadata: Metadata) -> int:
    """How many episodes are in a snapshot."""
    return int(metadata.get("episode", "0"))


def _is_of(config: RunConfig, science: str) -> bool:
    """Whether a file's science is that of a configuration, however its version wrote it."""
    try:
        return config_of_science(science).science == config.science
    except (ValueError, ConfigError):
        return False
