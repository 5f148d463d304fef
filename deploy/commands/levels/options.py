"""What several verbs on levels are told, and how it is passed on to `tools.levels.tasks`."""

from pathlib import Path
from typing import Annotated

import typer

from common.levels.distributions import shipped
from common.strict import ConfigError, nearest

TASKS = "tools.levels.tasks"  # the process that does the work

Bank = Annotated[
    Path | None, typer.Option(help="The bank's folder; default: $RAILCTL_LEVELS, or .levels beside the runs.")
]
Level = Annotated[str, typer.Option(help="easy, medium or hard.")]
LevelFile = Annotated[Path | None, typer.Argument(metavar="FILE", help="A .npz or .pkl file.", exists=True)]


def option(name: str, value: object) -> list[str]:
    return [] if value is None else [name, str(value)]


def known(level: str) -> str:
    if level not in list(shipped()):
        raise ConfigError(f"--level {level!r}{nearest(level, list(list(shipped())))}")
    return level
