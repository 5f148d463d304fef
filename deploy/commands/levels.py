"""railctl levels: the bank of generated levels, pictures, and levels from and for flatland-rl."""

import os
import re
from pathlib import Path
from typing import Annotated

import typer

from common.config import DIFFICULTIES, ConfigError, nearest
from common.levels.bank import bank_root
from deploy.levels import run_task
from deploy.output import AsJson, one_line_errors, say
from deploy.runs import runs_root

app = typer.Typer(help="Build, show, verify, import and export levels.", no_args_is_help=True)

Bank = Annotated[Path | None, typer.Option(help="The bank's folder.  [default: $RAILCTL_LEVELS or runs/.levels]")]
Level = Annotated[str, typer.Option(help="easy, medium or hard.")]
LevelFile = Annotated[Path | None, typer.Argument(metavar="[FILE]", help="A .npz or .pkl file.", exists=True)]
SEEDS = re.compile(r"^(\d+)(?:-(\d+))?$")


@app.command()
@one_line_errors
def build(
    level: Annotated[
        list[str] | None, typer.Option(help="easy, medium or hard; may be repeated.  [default: all]")
    ] = None,
    seeds: Annotated[str, typer.Option(help="Seeds of the runs that shall find their levels, as 3 or 1-10.")] = "1-10",
    episodes: Annotated[int, typer.Option(help="Training episodes of each run.", min=0)] = 1500,
    evaluation: Annotated[int, typer.Option(help="Evaluation levels.", min=0)] = 1000,
    processes: Annotated[int | None, typer.Option(help="Processes to build with.  [default: all cores]", min=1)] = None,
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Generate levels ahead of time, for all runs; goes on where an earlier build was stopped."""
    found = SEEDS.match(seeds)
    if found is None:
        raise ConfigError(f"--seeds {seeds!r}: use a number, or two as 1-10")
    first, last = found[1], found[2] or found[1]
    result = run_task(
        "build",
        *_option("--bank", bank or bank_root(runs_root())),
        *("--level", *[_known(name) for name in level or DIFFICULTIES]),
        *("--first-seed", first, "--last-seed", last, "--episodes", str(episodes), "--evaluation", str(evaluation)),
        *_option("--processes", processes or len(os.sched_getaffinity(0))),
        quiet=as_json,
    )
    counts = ", ".join(f"{count} {name}" for name, count in result["levels"].items())
    say(f"{result['bank']} holds {counts}; {sum(result['built'].values())} are new", result, as_json=as_json)


@app.command()
@one_line_errors
def verify(
    sample: Annotated[int, typer.Option(help="How many levels to generate again.", min=0)] = 100,
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Check every level of the bank against its hash, and a sample against the generator."""
    root = bank or bank_root(runs_root())
    result = run_task("verify", *_option("--bank", root), *_option("--sample", sample), quiet=as_json)
    say(f"{root}: {result['levels']} levels are as they were written", result, as_json=as_json)


@app.command()
@one_line_errors
def show(
    file: LevelFile = None,
    level: Level = "easy",
    seed: Annotated[int, typer.Option(help="Seed of the generator.", min=0)] = 0,
    evaluation: Annotated[int | None, typer.Option(help="Or the number of an evaluation level.", min=0)] = None,
    group: Annotated[str | None, typer.Option(help="Group in a .npz file.  [default: the first]")] = None,
    index: Annotated[int, typer.Option(help="Number in the group.", min=0)] = 0,
    output: Annotated[Path, typer.Option(help="The picture.")] = Path("level.png"),
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Draw a level: rails, trains with their headings, targets and shortest ways."""
    result = run_task(
        "show",
        *_option("--file", file),
        *_option("--bank", bank or bank_root(runs_root())),
        *_option("--level", _known(level)),
        *_option("--seed", seed),
        *_option("--evaluation", evaluation),
        *_option("--group", group),
        *_option("--index", index),
        *_option("--output", output),
        quiet=as_json,
    )
    text = (
        f"{result['title']}: {result['trains']} trains, {result['rail_cells']} cells of rail, "
        f"{result['switches']} switches, {result['max_steps']} steps\npicture  {result['picture']}"
    )
    say(text, result, as_json=as_json)


@app.command("import")
@one_line_errors
def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=".pkl of flatland-rl, or .npz.", exists=True)],
    output: Annotated[Path, typer.Option(help="The .npz file to write.")] = Path("levels.npz"),
    group: Annotated[str | None, typer.Option(help="Put all levels into one group of this name.")] = None,
    as_json: AsJson = False,
) -> None:
    """Gather levels of flatland-rl pickles or .npz files in one .npz file; speeds and timetables are left out."""
    result = run_task(
        "import", *map(str, files), *_option("--group", group), *_option("--output", output), quiet=as_json
    )
    say(f"{output}: {_counts(result['groups'])}", result, as_json=as_json)


@app.command()
@one_line_errors
def export(
    file: LevelFile = None,
    level: Level = "easy",
    count: Annotated[int, typer.Option(help="How many levels.", min=1)] = 100,
    seed: Annotated[
        int | None, typer.Option(help="Training levels of this run seed.  [default: evaluation levels]")
    ] = None,
    output: Annotated[Path, typer.Option(help="A .npz file, or a folder for .pkl files of flatland-rl.")] = Path(
        "levels.npz"
    ),
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Write levels to a file, for other programs or for flatland-rl's own tools."""
    result = run_task(
        "export",
        *_option("--file", file),
        *_option("--bank", bank or bank_root(runs_root())),
        *_option("--level", _known(level)),
        *_option("--count", count),
        *_option("--seed", seed),
        *_option("--output", output),
        quiet=as_json,
    )
    say(f"{output}: {_counts(result['groups'])} in {result['files']} files", result, as_json=as_json)


def _option(name: str, value: object) -> list[str]:
    return [] if value is None else [name, str(value)]


def _known(level: str) -> str:
    if level not in DIFFICULTIES:
        raise ConfigError(f"--level {level!r}{nearest(level, list(DIFFICULTIES))}")
    return level


def _counts(groups: dict[str, int]) -> str:
    return ", ".join(f"{count} levels of {name}" for name, count in groups.items())
