"""Finding the snapshot that a run goes on from, and seeing that it is this run's and its rows are there."""

from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError, Metadata, Tensors
from railctl.common.config import RunConfig, config_of_science
from railctl.common.folder import RunFolder, numbered
from railctl.common.records.rows import EpisodeRow
from railctl.common.strict import ConfigError


class Snapshot(NamedTuple):
    """What a run goes on from, and the newer files that are `damaged`: it comes to the same curve from here too."""

    tensors: Tensors
    metadata: Metadata
    damaged: list[Path]


def newest_snapshot(folder: RunFolder, config: RunConfig) -> Snapshot | None:
    """A run's newest snapshot that can be read, or none before the first.

    Raises:
        CheckpointError: none can be, and the text names the newest, and what deleting them leads to; or it belongs to
            another configuration.
    """
    paths = numbered(folder.snapshots)[::-1]
    errors: list[CheckpointError] = []
    for number, path in enumerate(paths):
        try:
            found = Snapshot(*checkpoint.load(path, "snapshot"), damaged=paths[:number])
        except CheckpointError as error:
            errors.append(error)
        else:
            _check_configuration(config, found.metadata)
            return found
    if not errors:
        return None
    whole = "it" if len(errors) == 1 else f"all {len(errors)} of {folder.snapshots}"
    raise CheckpointError(f"{errors[0]}, or delete {whole} to go on from the start, to the same curve")


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


def _check_configuration(config: RunConfig, metadata: Metadata) -> None:
    """Raises CheckpointError if a snapshot is not of a configuration, however its version wrote it."""
    try:
        same = config_of_science(metadata.get("science", "")).science == config.science
    except (ValueError, ConfigError):
        same = False
    if not same:
        raise CheckpointError(
            "the newest snapshot has another configuration: restore config.yaml or use a new run name"
        )
