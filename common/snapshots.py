"""Finding the snapshot that a run goes on from."""

from common import checkpoint
from common.checkpoint import CheckpointError, Metadata, Tensors
from common.folder import RunFolder


def newest_snapshot(folder: RunFolder) -> tuple[Tensors, Metadata] | None:
    """The content of a run's newest snapshot, or none before the first.

    Raises:
        CheckpointError: it is damaged; the text names it and what deleting it leads to.
    """
    paths = sorted(folder.snapshots.glob("*.safetensors"))
    if not paths:
        return None
    try:
        return checkpoint.load(paths[-1], "snapshot")
    except CheckpointError as error:
        before = f"from {paths[-2].name}" if len(paths) > 1 else "from the start"
        raise CheckpointError(f"{error}, or delete it to go on {before}, to the same curve") from None
