"""Level distributions that the command line knows: those that ship, and those of a run file."""

from pathlib import Path

from common.levels.distributions import AnyLevels, shipped
from deploy.resolve import read_file, world_of


def levels_of_run_file(path: Path) -> dict[str, AnyLevels]:
    """What a run file says under `levels`, its level files read.

    Raises:
        ConfigError: it cannot be read, or something in it is wrong.
    """
    own = read_file(path).get("levels") or {}
    return dict(world_of({"levels": own}, path.parent).levels) if own else {}


def known_levels(path: Path | None) -> dict[str, AnyLevels]:
    """All distributions by name: those that ship, and those of a run file.

    Raises:
        ConfigError: as `levels_of_run_file`.
    """
    return {**shipped(), **(levels_of_run_file(path) if path else {})}
