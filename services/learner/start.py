"""What a run begins with, out of its own copies: the network of a checkpoint, demonstrations."""

from collections.abc import Iterator

from railctl.common.checkpoint import Tensors, load
from railctl.common.config import RunConfig
from railctl.common.demonstrations import DemonstrationsError, digest_of_file, read_demonstrations
from railctl.common.folder import RunFolder
from railctl.common.records.course import Course


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


def demonstrations_of(folder: RunFolder, config: RunConfig) -> Iterator[Course]:
    """The episodes of the demonstrations, if there are any; they are read as they are asked for.

    Raises:
        ValueError: the copy is missing, or another file than the run began with, or of another version's schema.
    """
    given = config.learning.demonstrated
    if given is None:
        return
    try:
        digest = digest_of_file(folder.demonstrations_file)
    except OSError as error:
        raise ValueError(f"{folder.demonstrations_file}: {error.strerror}: restore it") from None
    if digest != given.digest:
        raise ValueError(f"{folder.demonstrations_file}: is not what the run began with: restore it")
    try:
        yield from read_demonstrations(folder.demonstrations_file)[1]
    except DemonstrationsError as error:
        raise ValueError(str(error)) from None
