"""railctl bench: ours beside others, in a process of its own that may import both."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Annotated

import typer

from railctl.common.interpreter import run_worker
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.deploy.output import AsJson, one_line_errors
from railctl.deploy.plan import ENVIRONMENT
from railctl.deploy.runs import Failed
from railctl.deploy.task import end

BENCHES = {
    "world": "railctl.tools.bench.world",
    "policy": "railctl.tools.bench.policy",
    "levels": "railctl.tools.bench.levels",
    "learner": "railctl.tools.bench.learner",
    "replay": "railctl.tools.bench.replay",
    "cluster": "railctl.tools.bench.cluster",
    "loop": "railctl.tools.bench.loop",
}
WITH_WORLDS = ("world", "policy", "levels")  # that play so many worlds, or make so many levels
TAKES = {
    "repeats": (*WITH_WORLDS, "learner", "replay", "loop"),
    "worlds": WITH_WORLDS,
    "episodes": ("cluster", "loop"),
    "observation": ("policy",),
    "interlocking": ("policy",),
    "level": ("cluster", "loop"),
    "algorithm": ("cluster",),
    "lag": ("cluster",),
    "actors": ("cluster",),
    "machines": ("cluster",),
}
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
BY_SIGNAL = 128  # and its number, as shells say it
END_PATIENCE_S = 20.0
LOOK_S = 0.1


@one_line_errors
def bench(
    what: Annotated[str, typer.Argument(metavar="WHAT", help=f"One of {', '.join(BENCHES)}.")],
    repeats: Annotated[
        int | None, typer.Option(help="Repeats, whose medians are taken; default: 5, of loop 3.")
    ] = None,
    worlds: Annotated[
        int | None, typer.Option(help=f"In a repeat, of {', '.join(WITH_WORLDS)}; default: each one's own.")
    ] = None,
    episodes: Annotated[int | None, typer.Option(help="Of each run of cluster or loop; default: 300 or 40.")] = None,
    observation: Annotated[str | None, typer.Option(help="Of ours in policy, tree or traffic; default: tree.")] = None,
    interlocking: Annotated[
        str | None, typer.Option(help="Of ours in policy: off, valid, safe or planned; default: off.")
    ] = None,
    level: Annotated[str | None, typer.Option(help="Of the runs of cluster or loop; default: easy.")] = None,
    algorithm: Annotated[
        list[str] | None, typer.Option(help="Of cluster; may be repeated; default: the study's.")
    ] = None,
    lag: Annotated[
        list[str] | None, typer.Option(help="Of cluster, a number or free; may be repeated; default: 0, 3, free.")
    ] = None,
    actors: Annotated[
        list[int] | None, typer.Option(help="Of cluster, by each lag; may be repeated; default: 2, at lag 0 0 and 1.")
    ] = None,
    machines: Annotated[
        list[int] | None,
        typer.Option(help="Of cluster, network namespaces that have the actors; may be repeated; default: 0, none."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure ours beside others: same work, one process, one core; a ratio above 1 says that ours is better.

    cluster runs whole clusters beside the same work in one process without messages, loop whole runs beside a plain
    loop over flatland-rl and torch.
    """
    if what not in BENCHES:
        raise ConfigError(f"unknown benchmark {shortened(what)}{nearest(what, list(BENCHES))}")
    options = {
        "repeats": repeats,
        "worlds": worlds,
        "episodes": episodes,
        "observation": observation,
        "interlocking": interlocking,
        "level": level,
        "algorithm": algorithm,
        "lag": lag,
        "actors": actors,
        "machines": machines,
    }
    command = run_worker(BENCHES[what])
    for option, given in options.items():
        if given is None:
            continue
        if what not in TAKES[option]:
            raise ConfigError(f"--{option}: bench {what} has no use for it, leave it out")
        if isinstance(given, int) and given < 1:
            raise ConfigError(f"--{option} {given}: use a number above 0")
        for value in given if isinstance(given, list) else [given]:
            command += [f"--{option}", str(value)]
    code = _run([*command, "--json"] if as_json else command)
    if code < 0:
        raise Failed(f"bench {what} was killed by signal {-code}: run it again")
    if code:
        sys.exit(code)


def _run(command: list[str]) -> int:
    """Run a command to its end; it speaks for itself, and is no concern of the terminal's Ctrl-C, but of ours."""
    asked: SimpleQueue[int] = SimpleQueue()  # an exception might come while it starts
    before = {number: signal.signal(number, lambda got, _frame: asked.put(got)) for number in ENDING}
    try:
        with subprocess.Popen(command, env=os.environ | ENVIRONMENT, process_group=0) as process:
            while process.poll() is None:
                with suppress(Empty):
                    number = asked.get(timeout=LOOK_S)
                    end(process, END_PATIENCE_S)  # a run that it started has to be stopped
                    sys.exit(BY_SIGNAL + number)
            return process.returncode
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
