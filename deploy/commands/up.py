"""railctl up: start a run, or go on with one, and show it until it ends."""

from pathlib import Path
from typing import Annotated, Any

import typer

from common.config import RunConfig
from common.folder import RunFolder
from common.levels.bank import bank_root
from common.locks import living
from common.records.rows import EpisodeRow, EvaluationRow
from common.rows import read_rows
from deploy.commands.scale import scale_to
from deploy.follow import outcome_of
from deploy.launch import (
    check_door,
    check_existing,
    check_name,
    check_new,
    fresh_name,
    new_run,
    save_config,
    start_supervisor,
)
from deploy.levels import prepare_levels, read_own
from deploy.output import console, counted, one_line_errors, print_table
from deploy.resolve import algorithms, merge, parse_actors, parse_lag, parse_sets, read_file, resolve, resolve_existing
from deploy.runs import Failed, runs_root, supervised
from deploy.show import summary
from deploy.watch import watch


@one_line_errors
def up(
    file: Annotated[Path | None, typer.Option("--file", "-f", help="Run file (YAML).")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the run; an existing one goes on.")] = None,
    algorithm: Annotated[str | None, typer.Option(help=f"Preset: {', '.join(algorithms())}; default: dddqn.")] = None,
    level: Annotated[
        str | None, typer.Option(help="Name of levels that ship, or of the run file; default: easy.")
    ] = None,
    actors: Annotated[
        str | None,
        typer.Option(
            help="By level, as easy=2,hard=1, or any=2; default: one a level, with lag 0 none: the learner acts."
        ),
    ] = None,
    episodes: Annotated[int | None, typer.Option(help="Episodes to train; default: 1500.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of everything random; default: 1.")] = None,
    lag: Annotated[
        str | None,
        typer.Option(
            help="Episodes that run ahead of training, or free: as many as help, with the newest weights; default: 0."
        ),
    ] = None,
    cores: Annotated[int | None, typer.Option(help="Cores that all processes share; default: 2.")] = None,
    engine: Annotated[str | None, typer.Option(help="Of the worlds, compiled or flatland; default: compiled.")] = None,
    listen: Annotated[
        str | None, typer.Option(help="Where other machines join, as tls/0.0.0.0:7447; needs --keys.")
    ] = None,
    keys: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder that railctl keys create made.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Any setting, as dqn.batch_size=64; may be repeated.")
    ] = None,
    detach: Annotated[bool, typer.Option("--detach", help="Return at once; attach with railctl tail.")] = False,
) -> None:
    """Start a run or go on with one: router, learner, actors, evaluator and their supervisor."""
    given: dict[str, Any] = {} if file is None else read_file(file)
    base = Path() if file is None else file.parent
    options = {
        "algorithm": algorithm,
        "level": level,
        "episodes": episodes,
        "seed": seed,
        "lag": None if lag is None else parse_lag(lag),
        "engine": engine,
        "cluster": {
            "actors": parse_actors(actors) if actors else None,
            "cores": cores,
            "listen": listen,
            "keys": None if keys is None else str(keys.absolute()),
        },
    }
    if level is not None:
        given.pop("mix", None)  # options go before the file
    given = merge(merge(given, without_none(options)), parse_sets(settings or []))
    folder, config = prepare(name, given, base)
    if outcome_of(folder)[0] == "finished" and not living(folder):
        console.print(f"run {folder.path.name} is finished", markup=False)
        conclude(folder)
        return
    if supervised(folder):
        console.print(f"run {folder.path.name} is running already", markup=False)
        if actors:
            console.print(scale_to(folder, parse_actors(actors)), markup=False)
    else:
        start_supervisor(folder, config, given.get("cluster", {}).get("actors"))
    console.print(f"run {folder.path.name} in {folder.path}", markup=False, soft_wrap=True)
    if detach:
        console.print(f"follow it with: railctl tail {folder.path.name}", markup=False, soft_wrap=True)
        return
    watch(folder)
    conclude(folder)


def without_none(options: dict[str, Any]) -> dict[str, Any]:
    """Only what was given."""
    kept = {key: without_none(value) if isinstance(value, dict) else value for key, value in options.items()}
    return {key: value for key, value in kept.items() if value is not None and value != {}}


def prepare(name: str | None, given: dict[str, Any], base: Path = Path()) -> tuple[RunFolder, RunConfig]:
    """The folder and configuration of a new run, or of the one that has this name."""
    for part in [] if name is None else name.split("/"):  # a study's runs lie in its folder
        check_name(part)
    if name is None or not (runs_root() / name / "config.yaml").exists():
        config = resolve(given, base)
        name = name or fresh_name(config)
        check_new(name, config)
        own = read_own(config.world.levels, base)
        for note in (note for read in own.values() for note in read.left_out):
            console.print(note, markup=False, soft_wrap=True)
        _prepare_levels(config)
        return new_run(name, config, own=own, base=base), config
    folder = RunFolder(runs_root() / name)
    config = resolve_existing(folder.config(), given, name, base)
    if supervised(folder):
        check_door(folder, config)
    else:
        check_existing(folder, config)
        _prepare_levels(config)
        save_config(folder, config)
    return folder, config


def _prepare_levels(config: RunConfig) -> None:
    prepare_levels(config.world.levels, bank_root(runs_root()), config.cluster.cores)


def conclude(folder: RunFolder) -> None:
    """Print how a run ended: its table, folder and picture.

    Raises:
        Failed: the run failed.
    """
    outcome, reason = outcome_of(folder)
    episodes = read_rows(folder.episodes_file, EpisodeRow)
    if episodes:
        print_table(summary(episodes, read_rows(folder.evaluations_file, EvaluationRow)))
        console.print(f"curve    {folder.curve_file}", markup=False, soft_wrap=True)
    console.print(f"run      {folder.path}", markup=False, soft_wrap=True)
    if outcome == "failed":
        raise Failed(reason)
    if outcome == "stopped":
        console.print(
            f"stopped after {counted(len(episodes), 'episode')}; railctl up --name {folder.path.name} goes on",
            markup=False,
            soft_wrap=True,
        )
