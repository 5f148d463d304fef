"""The checkpoint that a run begins with: found, and seen to be of a network that the run could have."""

import shutil
from pathlib import Path

from railctl.common.checkpoint import CheckpointError, load
from railctl.common.config import RunConfig, config_of_science
from railctl.common.rules.settings import StartFrom
from railctl.common.strict import ConfigError
from railctl.deploy.runs import Failed


def with_start_read(config: RunConfig, base: Path) -> RunConfig:
    """The same configuration, which knows the digest of the checkpoint that it begins with, if it does with one.

    Args:
        config: of a run that shall be made.
        base: where relative paths start.

    Raises:
        ConfigError: the file cannot be used, is of another network or of a world in which trains see something else,
            or is not the one whose digest is given.
    """
    start = config.learning.begins_with
    if start is None:
        return config
    field = f"start_from.checkpoint {start.checkpoint}"
    try:
        _, metadata = load(base / start.checkpoint, "checkpoint")
        theirs = config_of_science(metadata["science"])
    except CheckpointError as error:
        raise ConfigError(f"start_from.checkpoint {error}") from None
    except (KeyError, ValueError):
        raise ConfigError(f"{field}: does not say what run it is of: give one of a run of this version") from None
    if start.digest not in (None, metadata["digest"]):
        raise ConfigError(f"{field}: is not the file of start_from.digest {start.digest}: leave the digest out")
    if not theirs.learning.has_probabilities or theirs.learning.network != config.learning.network:
        raise ConfigError(
            f"{field}: its network is {_told(theirs)}, that of the run {_told(config)}: give the run the same"
        )
    if (theirs.world.observation, theirs.world.n_features) != (config.world.observation, config.world.n_features):
        raise ConfigError(
            f"{field}: its trains see {_seen(theirs)}, those of the run {_seen(config)}: give the run its observation"
        )
    found = StartFrom(checkpoint=start.checkpoint, digest=metadata["digest"])
    return config.model_copy(update={"learning": config.learning.model_copy(update={"start_from": found})})


def checkpoint_digest(path: Path) -> str:
    """Of a checkpoint's content; raises ConfigError if it cannot be used."""
    try:
        return load(path, "checkpoint")[1]["digest"]
    except CheckpointError as error:
        raise ConfigError(f"start_from.checkpoint {error}") from None


def copy_start(config: RunConfig, base: Path, copy: Path) -> None:
    """Make the run's copy of the checkpoint that it begins with, if it does with one.

    Raises:
        Failed: the file has changed since it was read.
        OSError: it cannot be copied.
    """
    start = config.learning.begins_with
    if start is None:
        return
    shutil.copyfile(base / start.checkpoint, copy)
    try:
        _, metadata = load(copy, "checkpoint")
    except CheckpointError as error:
        raise Failed(str(error)) from None
    if metadata["digest"] != start.digest:
        raise Failed(f"{start.checkpoint} has changed while the run was made: start it again")


def _told(config: RunConfig) -> str:
    network = config.learning.network
    return f"{network.kind} {list(network.hidden)}"


def _seen(config: RunConfig) -> str:
    return f"{config.world.n_features} features ({config.world.observation.kind})"
