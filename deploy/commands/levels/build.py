"""railctl levels build: fill the bank."""

import os
import re
from typing import Annotated

import typer

from railctl.common.levels.distributions import LevelFiles
from railctl.common.levels.requests import BuildRequest
from railctl.common.strict import ConfigError, shortened
from railctl.deploy.commands.levels.options import Bank, RunFile, bank_at, chosen
from railctl.deploy.levels import ask, known_levels
from railctl.deploy.output import AsJson, one_line_errors, say

SEEDS = re.compile(r"([0-9]{1,10})(?:-([0-9]{1,10}))?")
MOST_LEVELS = 10_000_000


@one_line_errors
def build(
    level: Annotated[
        list[str] | None, typer.Option(help="Name of levels; may be repeated; default: all that can be built.")
    ] = None,
    file: RunFile = None,
    seeds: Annotated[str, typer.Option(help="Seeds of the runs that shall find their levels, as 3 or 1-10.")] = "1-10",
    episodes: Annotated[int, typer.Option(help="Training episodes of each run.", min=0)] = 1500,
    evaluation: Annotated[
        int | None, typer.Option(help="Evaluation levels; default: all that are held out.", min=0)
    ] = None,
    processes: Annotated[int | None, typer.Option(help="Processes to build with; default: one a core.", min=1)] = None,
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Generate levels ahead of time, for all runs; goes on where an earlier build was stopped."""
    first, last = _span(seeds)
    if (last - first + 1) * episodes > MOST_LEVELS:
        raise ConfigError(f"--seeds {seeds} and --episodes {episodes}: {MOST_LEVELS} training levels are the most")
    known = known_levels(file)
    names = level or [name for name, levels in known.items() if not isinstance(levels, LevelFiles)]
    result = ask(
        BuildRequest(
            bank=bank_at(bank),
            levels=chosen(names, file),
            first_seed=first,
            last_seed=last,
            episodes=episodes,
            evaluation=evaluation,
            processes=processes or len(os.sched_getaffinity(0)),
        )
    )
    counts = ", ".join(f"{count} {name}" for name, count in result["levels"].items())
    say(f"{result['bank']} holds {counts}; {sum(result['built'].values())} new", result, as_json=as_json)


def _span(seeds: str) -> tuple[int, int]:
    """The first and the last of the seeds.

    Raises:
        ConfigError: they are none.
    """
    found = SEEDS.fullmatch(seeds)
    first, last = (0, -1) if found is None else (int(found[1]), int(found[2] or found[1]))
    if not first <= last < 2**31:
        raise ConfigError(f"--seeds {shortened(seeds)}: use a number below 2**31, or two as 1-10, the least first")
    return first, last
