"""railctl up: start a run, or go on with one, and show it until it ends."""

from pathlib import Path
from typing import Annotated, Any

import typer

from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder
from railctl.common.levels.bank import bank_root
from railctl.common.locks import living
from railctl.common.records.rows import EpisodeRow, EvaluationRow
from railctl.common.rows import read_rows
from railctl.deploy.commands.run_options import (
    Actors,
    Algorithm,
    Cores,
    Engine,
    Episodes,
    Lag,
    Level,
    OfName,
    RunFile,
    Seed,
    Settings,
    base_of,
    given_by,
)
from railctl.deploy.commands.scale import scale_to
from railctl.deploy.follow import outcome_of
from railctl.deploy.foreground import follow_to_end
from railctl.deploy.launch import (
    check_door,
    check_existing,
    check_name,
    check_new,
    fresh_name,
    new_run,
    save_config,
    start_supervisor,
)
from railctl.deploy.levels import prepare_levels, read_own
from railctl.deploy.output import console, counted, one_line_errors, print_table
from railctl.deploy.resolve import parse_actors, resolve, resolve_existing
from railctl.deploy.runs import Failed, check_here, runs_root, supervised
from railctl.deploy.show import summary


@one_line_errors
def up(
    file: RunFile = None,
    name: OfName = None,
    algorithm: Algorithm = None,
    level: Level = None,
    actors: Actors = None,
    episodes: Episodes = None,
    seed: Seed = None,
    lag: Lag = None,
    cores: Cores = None,
    engine: Engine = None,
    listen: Annotated[
        str | None, typer.Option(help="Where other machines join, as tls/0.0.0.0:7447; needs --keys.")
    ] = None,
    keys: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder that railctl keys create made.")] = None,
    settings: Settings = None,
    detach: Annotated[bool, typer.Option("--detach", help="Return at once; attach with railctl tail.")] = False,
) -> None:
    """Start a run or go on with one: router, learner, actors, evaluator and their supervisor."""
    cluster = {
        "actors": parse_actors(actors) if actors else None,
        "cores": cores,
        "listen": listen,
        "keys": None if keys is None else str(keys.absolute()),
    }
    given = given_by(
        file,
        settings,
        algorithm=algorithm,
        level=level,
        episodes=episodes,
        seed=seed,
        lag=lag,
        engine=engine,
        cluster=cluster,
    )
    folder, config = prepare(name, given, base_of(file))
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
    conclude(folder, terminated=follow_to_end(folder))


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
    check_here(folder)
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


def conclude(folder: RunFolder, *, terminated: bool = False) -> None:
    """Print how a run ended: its table, folder and picture.

    Raises:
        Failed: the run failed, or was stopped by SIGTERM: whoever sent it shall not take it for done.
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
        text = f"stopped after {counted(len(episodes), 'episode')}; railctl up --name {folder.path.name} goes on"
        if terminated:
            raise Failed(f"SIGTERM: {text}")
        console.print(text, markup=False, soft_wrap=True)
