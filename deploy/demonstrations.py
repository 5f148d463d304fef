"""The demonstrations that a run's replay begins with: found, and seen to be of the run's world."""

import shutil
from pathlib import Path

from railctl.common.config import RunConfig
from railctl.common.demonstrations import DemonstrationsError, digest_of, digest_of_file, read_demonstrations
from railctl.common.strict import ConfigError
from railctl.deploy.runs import Failed


def with_demonstrations_read(config: RunConfig, base: Path) -> RunConfig:
    """The same configuration, which knows the digest of the demonstrations that it begins with, if it does with some.

    Args:
        config: of a run that shall be made.
        base: where relative paths start.

    Raises:
        ConfigError: the file cannot be used, is of another world, holds more decisions than the replay, or is not the
            one whose digest is given.
    """
    given = config.learning.demonstrated
    if given is None:
        return config
    path, field = base / given.file, f"demonstrations.file {given.file}"
    try:
        heading, courses = read_demonstrations(path)
        if heading.world != digest_of(config.world):
            raise ConfigError(
                f"{field}: was played in another world: make it with railctl demonstrate and the levels, observation, "
                "decisions, rewards, interlocking and patience of the run"
            )
        decisions = sum(len(course.decisions) for course in courses)
        digest = digest_of_file(path)
    except (DemonstrationsError, OSError) as error:
        raise ConfigError(f"demonstrations.file {error}") from None
    if given.digest not in (None, digest):
        raise ConfigError(f"{field}: is not the file of demonstrations.digest {given.digest}: leave the digest out")
    room = config.learning.room_for_demonstrations
    if decisions > room:
        raise ConfigError(
            f"{field}: has {decisions} decisions, replay.capacity is {room}: enlarge it, or give fewer episodes"
        )
    found = given.model_copy(update={"digest": digest})
    return config.model_copy(update={"learning": config.learning.model_copy(update={"demonstrations": found})})


def demonstrations_digest(path: Path) -> str:
    """Of a file's content; raises ConfigError if it cannot be read."""
    try:
        return digest_of_file(path)
    except OSError as error:
        raise ConfigError(f"demonstrations.file {path}: {error.strerror}: check its rights") from None


def copy_demonstrations(config: RunConfig, base: Path, copy: Path) -> None:
    """Make the run's copy of the demonstrations that it begins with, if it does with some.

    Raises:
        Failed: the file has changed since it was read.
        OSError: it cannot be copied.
    """
    given = config.learning.demonstrated
    if given is None:
        return
    shutil.copyfile(base / given.file, copy)
    if digest_of_file(copy) != given.digest:
        raise Failed(f"{given.file} has changed while the run was made: start it again")
