"""railctl levels show: draw a level."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.common.levels.requests import ShowRequest
from railctl.common.strict import ConfigError
from railctl.deploy.commands.levels.options import Bank, Level, LevelFile, RunFile, drawn_from
from railctl.deploy.levels import ask
from railctl.deploy.output import AsJson, check_replaceable, check_unused, counted, one_line_errors, say

SUFFIX = ".png"


@one_line_errors
def show(
    levels: LevelFile = None,
    level: Level = None,
    file: RunFile = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the generator; default: 0.", min=0)] = None,
    evaluation: Annotated[int | None, typer.Option(help="Or the number of an evaluation level.", min=0)] = None,
    group: Annotated[str | None, typer.Option(help="Group in a .npz file; default: the first.")] = None,
    index: Annotated[int | None, typer.Option(help="Number in the group, from 0; default: 0.", min=0)] = None,
    output: Annotated[Path, typer.Option(help=f"The {SUFFIX} to write; one that is there is replaced.")] = Path(
        f"level{SUFFIX}"
    ),
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Draw a level: rails, trains with their headings, targets and shortest ways."""
    of_file, of_others = {"--group": group, "--index": index}, {"--seed": seed, "--evaluation": evaluation}
    if levels is not None:
        others = {"--level": level, "-f": file, "--bank": bank, **of_others}
        check_unused(others, f"the level comes out of {levels}: leave it out")
    else:
        check_unused(of_file, f"it is said of a file: give FILE, or use {' or '.join(of_others)}")
    if evaluation is not None:
        check_unused({"--seed": seed}, f"--evaluation {evaluation} says which level: leave one out")
    if output.suffix != SUFFIX:
        raise ConfigError(f"--output {output}: use a name that ends with {SUFFIX}")
    check_replaceable(output, f"--output {output}")
    result = ask(
        ShowRequest(
            file=levels,
            drawn=None if levels is not None else drawn_from(level, file, bank),
            seed=seed or 0,
            evaluation=evaluation,
            group=group,
            index=index or 0,
            output=output,
        )
    )
    text = (
        f"{result['title']}: {counted(result['trains'], 'train')}, {result['rail_cells']} cells of rail, "
        f"{result['switches']} switches, {result['max_steps']} steps\n"
        f"picture  {result['picture']}"
    )
    say("\n".join([text, *result["left_out"]]), result, as_json=as_json)
