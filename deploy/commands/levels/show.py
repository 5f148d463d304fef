"""railctl levels show: draw a level."""

from pathlib import Path
from typing import Annotated

import typer

from common.levels.bank import bank_root
from deploy.commands.levels.options import TASKS, Bank, Level, LevelFile, known, option
from deploy.output import AsJson, counted, one_line_errors, say
from deploy.runs import runs_root
from deploy.task import run_task


@one_line_errors
def show(
    file: LevelFile = None,
    level: Level = "easy",
    seed: Annotated[int, typer.Option(help="Seed of the generator.", min=0)] = 0,
    evaluation: Annotated[int | None, typer.Option(help="Or the number of an evaluation level.", min=0)] = None,
    group: Annotated[str | None, typer.Option(help="Group in a .npz file; default: the first.")] = None,
    index: Annotated[int, typer.Option(help="Number in the group, from 0.", min=0)] = 0,
    output: Annotated[Path, typer.Option(help="The picture.")] = Path("level.png"),
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Draw a level: rails, trains with their headings, targets and shortest ways."""
    result = run_task(
        TASKS,
        "show",
        *option("--file", file),
        *option("--bank", bank or bank_root(runs_root())),
        *option("--level", known(level)),
        *option("--seed", seed),
        *option("--evaluation", evaluation),
        *option("--group", group),
        *option("--index", index),
        *option("--output", output),
    )
    text = (
        f"{result['title']}: {counted(result['trains'], 'train')}, {result['rail_cells']} cells of rail, "
        f"{result['switches']} switches, {result['max_steps']} steps\npicture  {result['picture']}"
    )
    say(text, result, as_json=as_json)
