"""Finding the snapshot that a run goes on from."""

from pathlib import Path
from typing import NamedTuple

from common import checkpoint
from common.checkpoint import CheckpointError, Metadata, Tensors
from common.folder import RunFolder


class Snapshot(NamedTuple):
    """What a run goes on from, and the newer files that are `damaged`: it comes to the same curve from here too."""

    tensors: Tensors
    metadata: Metadata
    damaged: list[Path]


def newest_snapshot(folder: RunFolder) -> Snapshot | None:
    """A run's newest snapshot that can be read, or none before the first.

    Raises:
        CheckpointError: none can be; the text names the newest, and what deleting them leads to.
    """
    paths = sorted(folder.snapshots.glob("*.safetensors"), reverse=True)
    errors: list[CheckpointError] = []
    for number, path in enumerate(paths):
        try:
            return Snapshot(*checkpoint.load(path, "snapshot"), damaged=paths[:number])
        except CheckpointError as error:
            errors.append(error)
    if not errors:
        return None
    whole = "it" if len(errors) == 1 else f"all {len(errors)} of {folder.snapshots}"
    raise CheckpointError(f"{errors[0]}, or delete {whole} to go on from the start, to the same curve")
