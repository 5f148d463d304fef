"""What several verbs are told of a run: the options of `railctl up` that say what it is."""

from pathlib import Path
from typing import Annotated, Any

import typer

from railctl.deploy.resolve import algorithms, merge, parse_lag, parse_sets, read_file

RunFile = Annotated[Path | None, typer.Option("--file", "-f", help="Run file (YAML).")]
OfName = Annotated[str | None, typer.Option("--name", help="Name of the run; an existing one goes on.")]
Algorithm = Annotated[str | None, typer.Option(help=f"Preset: {', '.join(algorithms())}; default: dddqn.")]
Level = Annotated[str | None, typer.Option(help="Name of levels that ship, or of the run file; default: easy.")]
Actors = Annotated[
    str | None,
    typer.Option(help="By level, as easy=2,hard=1, or any=2; default: one a level, with lag 0 none: the learner acts."),
]
Episodes = Annotated[int | None, typer.Option(help="Episodes to train; default: 1500.")]
Seed = Annotated[int | None, typer.Option(help="Of everything random; default: 1.")]
Lag = Annotated[
    str | None,
    typer.Option(help="Episodes that run ahead of training, or free: with the newest weights; default: 0."),
]
Cores = Annotated[int | None, typer.Option(help="Cores that all processes share; default: 2.")]
Engine = Annotated[str | None, typer.Option(help="Of the worlds, compiled or flatland; default: compiled.")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", help="Any setting, as dqn.batch_size=64; may be repeated.")
]


def given_by(file: Path | None, settings: list[str] | None, **options: Any) -> dict[str, Any]:
    """What a user says of a run: options, by their keys in a run file, go before its file, and `--set` before both.

    Raises:
        ConfigError: the file cannot be read, or a setting is none.
    """
    given: dict[str, Any] = {} if file is None else read_file(file)
    if options.get("lag") is not None:
        options["lag"] = parse_lag(options["lag"])
    if options.get("level") is not None:
        given.pop("mix", None)
    return merge(merge(given, without_none(options)), parse_sets(settings or []))


def base_of(file: Path | None) -> Path:
    """Where the paths that a run file names begin."""
    return Path() if file is None else file.parent


def without_none(options: dict[str, Any]) -> dict[str, Any]:
    """Only what was given."""
    kept = {key: without_none(value) if isinstance(value, dict) else value for key, value in options.items()}
    return {key: value for key, value in kept.items() if value is not None and value != {}}
