"""railctl levels show: draw a level."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.common.levels.bank import bank_root
from railctl.common.levels.requests import ShowRequest
from railctl.common.strict import ConfigError
from railctl.deploy.commands.levels.options import Bank, Level, LevelFile, RunFile, drawn_from
from railctl.deploy.levels import ask
from railctl.deploy.output import AsJson, counted, one_line_errors, say
from railctl.deploy.runs import runs_root


@one_line_errors
def show(
    levels: LevelFile = None,
    level: Level = "easy",
    file: RunFile = None,
    seed: Annotated[int, typer.Option(help="Seed of the generator.", min=0)] = 0,
    evaluation: Annotated[int | None, typer.Option(help="Or the number of an evaluation level.", min=0)] = None,
    group: Annotated[str | None, typer.Option(help="Group in a .npz file; default: the first.")] = None,
    index: Annotated[int, typer.Option(help="Number in the group, from 0.", min=0)] = 0,
    output: Annotated[Path, typer.Option(help="The picture.")] = Path("level.png"),
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Draw a level: rails, trains with their headings, targets and shortest ways."""
    if levels is not None and file is not None:
        raise ConfigError(f"-f {file}: the level comes out of {levels}, leave one out")
    drawn = None if levels is not None else drawn_from(level, file, bank or bank_root(runs_root()))
    result = ask(
        ShowRequest(file=levels, drawn=drawn, seed=seed, evaluation=evaluation, group=group, index=index, output=output)
    )
    text = (
        f"{result['title']}: {counted(result['trains'], 'train')}, {result['rail_cells']} cells of rail, "
        f"{result['switches']} switches, {result['max_steps']} steps\n"
        f"picture  {result['picture']}"
    )
    say("\n".join([text, *result["left_out"]]), result, as_json=as_json)
