"""The network that a run begins with, out of the run's own copy of a checkpoint."""

from common.checkpoint import Tensors, load
from common.config import RunConfig
from common.folder import RunFolder


def start_of(folder: RunFolder, config: RunConfig) -> Tensors | None:
    """The parameters by name; None: the seed makes them.

    Raises:
        ValueError: the copy is missing or damaged, or another file than the run began with.
    """
    start = config.learning.begins_with
    if start is None:
        return None
    tensors, metadata = load(folder.start_file, "checkpoint")
    if metadata["digest"] != start.digest:
        raise ValueError(f"{folder.start_file}: is not the checkpoint that the run began with: restore it")
    return tensors
