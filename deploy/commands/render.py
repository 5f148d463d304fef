"""railctl render: draw an episode of a checkpoint or a reference policy, or two beside each other."""

from pathlib import Path
from typing import Annotated, Any

import typer

from railctl.common.levels.bank import bank_root
from railctl.common.requests import FPS, LevelChoice
from railctl.common.strict import ConfigError
from railctl.deploy.commands.references import REFERENCES
from railctl.deploy.levels import levels_of_run_file
from railctl.deploy.output import AsJson, check_unused, counted, one_line_errors, say
from railctl.deploy.rendering import Rendering, check_output, told
from railctl.deploy.runs import runs_root


@one_line_errors
def render(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="RUN|CHECKPOINT|POLICY",
            help="A run: its newest checkpoint; a .safetensors file, or one that ships (pretrained/dispatch-hard); or "
            f"a policy: {', '.join(REFERENCES)}.",
        ),
    ],
    against: Annotated[
        str | None, typer.Option(metavar="OTHER", help="Another one, beside it on the same level.")
    ] = None,
    level: Annotated[
        str | None,
        typer.Option(
            help="Levels that ship, those of the checkpoint's run, or of --file; default: the largest that it was "
            "trained on, or that ship."
        ),
    ] = None,
    number: Annotated[int | None, typer.Option(help="Of the evaluation level, from 0; default: 0.", min=0)] = None,
    levels: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A level of a file instead: .npz, or flatland-rl's.")
    ] = None,
    group: Annotated[str | None, typer.Option(help="Group in the file of --levels; default: the first.")] = None,
    index: Annotated[int | None, typer.Option(help="Number in the group, from 0; default: 0.", min=0)] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Of the levels; default: 0, whose levels all runs are evaluated on.", min=0),
    ] = None,
    sample: Annotated[
        bool | None,
        typer.Option("--sample/--greedy", help="How checkpoints act; default: as their runs score them."),
    ] = None,
    draws: Annotated[
        int | None,
        typer.Option(help="Seed of what is drawn; default: the run's, for the policies 0.", min=0),
    ] = None,
    file: Annotated[Path | None, typer.Option("--file", "-f", help="Run file (YAML) with levels of your own.")] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What to write: .gif, .mp4 (with ffmpeg), or .png: its last moment; one that is there is replaced.",
        ),
    ] = None,
    step: Annotated[int | None, typer.Option(help="Of a .png: the step to draw instead.", min=0)] = None,
    fps: Annotated[
        float | None, typer.Option(help=f"Steps a second of a film; default: {FPS:g}.", min=1, max=50)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Draw an episode on its map, as a film or a picture; two policies beside each other with --against."""
    _check(
        levels, {"--group": group, "--index": index}, {"--level": level, "--number": number, "--seed": seed, "-f": file}
    )
    check_output(output, step, fps)
    name = level if levels is None else group
    choice = LevelChoice(
        names=None if name is None else (name,),
        own=levels_of_run_file(file) if file else {},
        base=file.parent.resolve() if file else Path(),
        file=levels,
        seed=seed or 0,
        bank=bank_root(runs_root()),
    )
    names = [policy] if against is None else [policy, against]
    rendering = Rendering(choice, (number if levels is None else index) or 0, sample, draws)
    drawn = rendering.draw(names, output, step, fps or FPS)
    size = f"{counted(drawn['pictures'], 'picture')}, {drawn['bytes'] / 1e6:.1f} MB"
    say("\n".join([*map(told, drawn["episodes"]), f"picture  {drawn['picture']}  ({size})"]), drawn, as_json=as_json)


def _check(levels: Path | None, of_files: dict[str, Any], of_others: dict[str, Any]) -> None:
    """Raise ConfigError if the options do not say one level."""
    if levels is None:
        check_unused(of_files, "it is said of a file: add --levels FILE, or use --level and --number")
    else:
        check_unused(of_others, f"the level comes out of {levels}: leave it out")
    if levels is not None and not levels.is_file():
        raise ConfigError(f"--levels {levels}: no such file")
