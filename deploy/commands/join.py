"""railctl join: act for a run whose router and learner are on another machine."""

import logging
import sys
from pathlib import Path
from typing import Annotated

import typer

from railctl.common.strict import ConfigError
from railctl.deploy.far import credentials_for
from railctl.deploy.join import join
from railctl.deploy.output import console, one_line_errors
from railctl.deploy.resolve import parse_actors


@one_line_errors
def join_run(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="Of the run's machine, as tls/node7:7447.")],
    keys: Annotated[Path, typer.Option(metavar="DIR", help="Folder with ca.pem, actor.pem and actor.key.")],
    actors: Annotated[str, typer.Option(help="By level, as easy=2,hard=1, or any=2.")],
    wait: Annotated[
        int, typer.Option(min=0, metavar="SECONDS", help="For a run that is not there yet; default: none.")
    ] = 0,
) -> None:
    """Act for a run on another machine, until it is trained or Ctrl-C; no folder of the run is needed here."""
    counts = {level: count for level, count in parse_actors(actors).items() if count}
    if not counts:
        raise ConfigError(f"--actors {actors}: give at least one")
    credentials = credentials_for(address, keys, "actor")
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(message)s")
    end = join(address, credentials, counts, wait)
    console.print("all episodes are trained" if end.outcome == "finished" else "left the run", markup=False)
