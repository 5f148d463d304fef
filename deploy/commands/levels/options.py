"""What several verbs on levels are told, and how it is passed on to `tools.levels.tasks`."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.common.levels.bank import bank_root, check_bank
from railctl.common.levels.distributions import AnyLevels, shipped
from railctl.common.levels.requests import Drawn
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.deploy.levels import known_levels
from railctl.deploy.runs import runs_root

LEVEL = "easy"  # unless it is said

Bank = Annotated[
    Path | None, typer.Option(help="The bank's folder; default: $RAILCTL_LEVELS, or .levels beside the runs.")
]
RunFile = Annotated[
    Path | None, typer.Option("--file", "-f", help="Run file whose own levels are known, too.", exists=True)
]
Level = Annotated[
    str | None,
    typer.Option(
        help=f"{', '.join(shipped())}, or a name under `levels` of the run file given with -f; default: {LEVEL}."
    ),
]
LevelFile = Annotated[
    Path | None, typer.Argument(metavar="FILE", help="A .npz file, or a .pkl or .mpk of flatland-rl.", exists=True)
]


def chosen(names: list[str], file: Path | None) -> dict[str, AnyLevels]:
    """The distributions of these names, of those that ship and those of a run file.

    Raises:
        ConfigError: there is none of a name.
    """
    known = known_levels(file)
    for name in names:
        if name not in known:
            raise ConfigError(f"--level {shortened(name)}{nearest(name, list(known))}")
    return {name: known[name] for name in names}


def bank_at(given: Path | None) -> Path:
    """The bank that is given, or else the one that all runs share.

    Raises:
        ConfigError: it cannot be one; or as `runs_root`, for what is asked names the working directory.
    """
    runs = runs_root()
    if given is None:
        return bank_root(runs)
    check_bank(given, f"--bank {given}")
    return given


def drawn_from(level: str | None, file: Path | None, bank: Path | None) -> Drawn:
    """Levels of a distribution, as a request; raises as `chosen` and `bank_at`."""
    name, base = level or LEVEL, Path() if file is None else file.parent
    return Drawn(name=name, levels=chosen([name], file)[name], bank=bank_at(bank), base=base.resolve())
