"""railctl place: what starts a run on the nodes of a site, printed and not started."""

from typing import Annotated, Literal

import typer

from railctl.common.strict import ConfigError
from railctl.deploy.backends.kubernetes import manifests
from railctl.deploy.backends.slurm import run_script
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
from railctl.deploy.launch import fresh_name
from railctl.deploy.output import one_line_errors
from railctl.deploy.placement import placed
from railctl.deploy.resolve import parse_actors, resolve
from railctl.deploy.runs import runs_root


@one_line_errors
def place(
    site: Annotated[Literal["slurm", "kubernetes"], typer.Argument(metavar="SITE", help="slurm or kubernetes.")],
    nodes: Annotated[int, typer.Option(help="Nodes (Kubernetes: pods), the run's host included.")],
    actors_per_node: Annotated[str, typer.Option(help="On each node but the host, as easy=4,hard=2, or any=4.")],
    image: Annotated[str | None, typer.Option(help="Kubernetes: the image to run, with railctl in it.")] = None,
    port: Annotated[int, typer.Option(help="Of the host, where the other nodes join; default: 7447.")] = 7447,
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
    settings: Settings = None,
) -> None:
    """Print what has Slurm or Kubernetes start a run on several nodes; it starts nothing itself."""
    cluster = {"actors": parse_actors(actors) if actors else None, "cores": cores}
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
    base = base_of(file)
    name = name or fresh_name(resolve(given, base))
    placement = placed(given, base, name, nodes, parse_actors(actors_per_node), port)
    if site == "slurm":
        if image is not None:
            raise ConfigError(f"--image {image}: nodes of Slurm have railctl on their path, leave it out")
        text = run_script(placement, runs_root().absolute())
    else:
        if image is None:
            raise ConfigError("--image is missing: name one with railctl in it (Dockerfile), as pods can pull it")
        text = manifests(placement, image)
    print(text, end="")
