"""railctl levels import and export: levels from and for flatland-rl and numpy."""

from pathlib import Path
from typing import Annotated

import typer

from common.levels.bank import bank_root
from deploy.commands.levels.options import TASKS, Bank, Level, LevelFile, known, option
from deploy.output import AsJson, counted, one_line_errors, say
from deploy.runs import runs_root
from deploy.task import run_task


@one_line_errors
def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help=".pkl of flatland-rl, or .npz.", exists=True)],
    output: Annotated[Path, typer.Option(help="The .npz file to write.")] = Path("levels.npz"),
    group: Annotated[str | None, typer.Option(help="Put all levels into one group of this name.")] = None,
    as_json: AsJson = False,
) -> None:
    """Gather levels of flatland-rl pickles or .npz files in one .npz file; speeds and timetables are left out."""
    result = run_task(TASKS, "import", *map(str, files), *option("--group", group), *option("--output", output))
    say(f"{output}: {_counts(result['groups'])}", result, as_json=as_json)


@one_line_errors
def export(
    file: LevelFile = None,
    level: Level = "easy",
    count: Annotated[int, typer.Option(help="How many levels.", min=1)] = 100,
    seed: Annotated[
        int | None, typer.Option(help="Training levels of runs with this seed; default: evaluation levels.")
    ] = None,
    output: Annotated[Path, typer.Option(help="A .npz file, or a folder for .pkl files of flatland-rl.")] = Path(
        "levels.npz"
    ),
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Write levels to a file, for other programs or for flatland-rl's own tools."""
    result = run_task(
        TASKS,
        "export",
        *option("--file", file),
        *option("--bank", bank or bank_root(runs_root())),
        *option("--level", known(level)),
        *option("--count", count),
        *option("--seed", seed),
        *option("--output", output),
    )
    say(f"{output}: {_counts(result['groups'])} in {counted(result['files'], 'file')}", result, as_json=as_json)


def _counts(groups: dict[str, int]) -> str:
    return ", ".join(f"{counted(count, 'level')} of {name}" for name, count in groups.items())
