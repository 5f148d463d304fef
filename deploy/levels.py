"""Level distributions that the command line knows: those that ship, and those of a run file."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from railctl.common.levels.distributions import AnyLevels, LevelFiles, shipped
from railctl.common.levels.held_out import is_prepared
from railctl.common.levels.own import ReadLevels, read_level_files
from railctl.common.levels.requests import PrepareRequest, Request
from railctl.common.world import read_world
from railctl.deploy.resolve import read_file, understood
from railctl.deploy.task import run_task

TASKS = "railctl.tools.levels.tasks"  # the process that does what needs flatland


def levels_of_run_file(path: Path) -> dict[str, AnyLevels]:
    """What a run file says under `levels`, its level files read.

    Raises:
        ConfigError: it cannot be read, or something in it is wrong.
    """
    _, _, given = understood(read_file(path))
    own = given.get("levels")
    return dict(read_world({"levels": own}, path.parent).levels) if own else {}


def known_levels(path: Path | None) -> dict[str, AnyLevels]:
    """All distributions by name: those that ship, and those of a run file.

    Raises:
        ConfigError: as `levels_of_run_file`.
    """
    return {**shipped(), **(levels_of_run_file(path) if path else {})}


def read_own(levels: Mapping[str, AnyLevels], base: Path) -> dict[str, ReadLevels]:
    """What the level files of these distributions hold; relative paths start from `base`.

    Raises:
        ConfigError: as `read_level_files`.
    """
    return {
        name: read_level_files(name, found, base) for name, found in levels.items() if isinstance(found, LevelFiles)
    }


def prepare_levels(levels: Mapping[str, AnyLevels], bank: Path, processes: int) -> None:
    """Find out what these distributions hold out, with progress; nothing happens if the bank knows.

    Raises:
        ConfigError: one of them cannot be used.
        Failed: the bank cannot be used.
    """
    unknown = {name: found for name, found in levels.items() if not is_prepared(bank, found)}
    if unknown:
        ask(PrepareRequest(bank=bank, levels=unknown, processes=processes))


def ask(request: Request) -> dict[str, Any]:
    """Have something done with levels in a process that may import flatland; raises as `run_task`."""
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        file.write(request.model_dump_json())
        file.flush()
        return run_task(TASKS, file.name)
