"""railctl levels import and export: levels from and for flatland-rl and numpy."""

from pathlib import Path
from typing import Annotated, Any

import typer

from railctl.common.levels.requests import ExportRequest, ImportRequest
from railctl.deploy.commands.levels.options import Bank, Level, LevelFile, RunFile, drawn_from
from railctl.deploy.levels import ask
from railctl.deploy.output import AsJson, check_free, check_unused, counted, one_line_errors, say


@one_line_errors
def import_(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help=".pkl or .mpk of flatland-rl since 2.0, or .npz.", exists=True),
    ],
    output: Annotated[Path, typer.Option(help="The .npz file to write.")] = Path("levels.npz"),
    group: Annotated[str | None, typer.Option(help="Put all levels into one group of this name.")] = None,
    as_json: AsJson = False,
) -> None:
    """Gather levels of flatland-rl's files or .npz files in one .npz file.

    Speeds, malfunctions and timetables come along; what cannot is named. Levels of one shape share a group. What is
    there already is not overwritten.
    """
    check_free(output, f"--output {output}")
    result = ask(ImportRequest(files=tuple(files), group=group, output=output))
    say("\n".join([*_read(result), f"{output}: {_counts(result['groups'])}"]), result, as_json=as_json)


@one_line_errors
def export(
    levels: LevelFile = None,
    level: Level = None,
    file: RunFile = None,
    count: Annotated[
        int | None, typer.Option(help="How many levels; default: 100, or all evaluation levels.", min=1)
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Training levels of runs with this seed; default: evaluation levels.", min=0)
    ] = None,
    output: Annotated[Path, typer.Option(help="A .npz file, or a folder for .pkl files of flatland-rl.")] = Path(
        "levels.npz"
    ),
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Write levels to a file, for other programs or for flatland-rl's own tools.

    What is there already is not overwritten.
    """
    if levels is not None:
        others = {"--level": level, "-f": file, "--count": count, "--seed": seed, "--bank": bank}
        check_unused(others, f"all levels come out of {levels}: leave it out")
    check_free(output, f"--output {output}")
    drawn = None if levels is not None else drawn_from(level, file, bank)
    result = ask(ExportRequest(file=levels, drawn=drawn, count=count, seed=seed, output=output))
    text = f"{output}: {_counts(result['groups'])} in {counted(result['files'], 'file')}"
    say("\n".join([*(f"{levels}: {note}" for note in result["left_out"]), text]), result, as_json=as_json)


def _counts(groups: dict[str, int]) -> str:
    return ", ".join(f"{counted(count, 'level')} of {name}" for name, count in groups.items())


def _read(result: dict[str, Any]) -> list[str]:
    """What every file holds, and what of it did not come along."""
    lines = []
    for file in result["files"]:
        lines += [
            f"{file['file']}: {_counts(file['groups'])}",
            *(f"{file['file']}: {note}" for note in file["left_out"]),
        ]
    return lines
