"""railctl logs: what the processes wrote."""

import time
from collections import deque
from pathlib import Path
from typing import Annotated

import typer

from railctl.common.folder import RunFolder
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.deploy.output import AsJson, RunName, one_line_errors, say
from railctl.deploy.runs import find_run

LOOK_S = 0.3
MOST_LINES = 1_000_000


@one_line_errors
def logs(
    run: RunName = None,
    process: Annotated[str | None, typer.Argument(metavar="PROCESS", help="One process; default: all.")] = None,
    lines: Annotated[int, typer.Option("--lines", "-n", min=0, max=MOST_LINES, help="Last lines of each log.")] = 20,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on as lines come; Ctrl-C ends.")] = False,
    as_json: AsJson = False,
) -> None:
    """Print the last lines of the logs of a run's processes, the supervisor's included."""
    if follow and as_json:
        raise ConfigError("--follow and --json: leave one out, a document that never ends is none")
    found = _files(find_run(run), process)
    tails = {name: list(_last(path, lines)) for name, path in found.items()}
    text = "\n".join(f"{name:<16} {line}" for name, tail in tails.items() for line in tail)
    positions = {name: path.stat().st_size for name, path in found.items()}
    say(text, tails, as_json=as_json)
    try:
        while follow:
            time.sleep(LOOK_S)
            for name, path in found.items():
                positions[name] = _print_from(name, path, positions[name])
    except KeyboardInterrupt:
        pass


def _files(folder: RunFolder, process: str | None) -> dict[str, Path]:
    found = {path.stem: path for path in sorted(folder.logs.glob("*.log"))}
    if process is None:
        return found
    if process not in found:
        raise ConfigError(f"run {folder.path.name} has no process {shortened(process)}{nearest(process, list(found))}")
    return {process: found[process]}


def _last(path: Path, lines: int) -> deque[str]:
    with path.open(errors="replace") as file:
        return deque((line.rstrip("\n") for line in file), maxlen=lines)


def _print_from(name: str, path: Path, position: int) -> int:
    with path.open(errors="replace") as file:
        file.seek(position)
        for line in file.readlines():  # tell() does not work between the lines of an iteration
            print(f"{name:<16} {line}", end="", flush=True)
        return file.tell()
