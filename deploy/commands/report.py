"""railctl report: figures and tables on runs, side by side, or how reliable given learning curves are."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.common.strict import ConfigError, nearest, shortened
from railctl.deploy.judged import TITLES, judged_parts
from railctl.deploy.output import AsJson, console, one_line_errors, say
from railctl.deploy.runs import find_run
from railctl.deploy.task import run_task

JUDGE, REPORTER = "railctl.analysis.reliability", "railctl.analysis.report"
PROTOCOLS = ["default", "tool"]


@one_line_errors
def report(
    runs: Annotated[
        list[str] | None, typer.Argument(metavar="RUN...", help="Names or folders of runs; default: the newest.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where it goes; default: report, in the run's folder if it is one."),
    ] = None,
    curves: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Judge the learning curves of a .npz file instead.")
    ] = None,
    random_protocol: Annotated[
        str | None, typer.Option(help="Of --curves: default, or tool: resample exactly as the original tool does.")
    ] = None,
    switch: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Of --curves: another reading of the metrics (docs/reliability.md); may be repeated.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare runs on a page that needs nothing else, or rank algorithms by how reliably they learn."""
    if curves is None:
        if random_protocol or switch:
            raise ConfigError("--random-protocol and --switch are for --curves: give a file, or leave them out")
        report_runs(runs or [None], output, as_json=as_json)
    else:
        if runs or output:
            raise ConfigError(f"--curves {curves} is judged alone, and printed: leave runs and --output out")
        report_curves(curves, random_protocol or PROTOCOLS[0], switch or [], as_json=as_json)


def report_runs(names: list[str] | list[None], output: Path | None, *, as_json: bool) -> None:
    """Make the page on runs.

    Raises:
        ConfigError: there is no such run, or they do not go together.
        Failed: one cannot be read.
    """
    folders = [find_run(name).path for name in names]
    folder = output or (folders[0] / "report" if len(folders) == 1 else Path("report"))
    result = run_task(REPORTER, *(part for run in folders for part in ("--run", str(run))), "--output", str(folder))
    states = ", ".join(f"{count} {state}" for state, count in result["runs"].items())
    text = f"{result['figures']} figures and {result['tables']} tables on runs: {states}\nreport   {result['report']}"
    say(text, result, as_json=as_json)


def report_curves(curves: Path, random_protocol: str, switches: list[str], *, as_json: bool) -> None:
    """Judge a file of curves.

    Raises:
        ConfigError: the options are wrong.
        Failed: the file is.
    """
    if not curves.is_file():
        raise ConfigError(f"--curves {curves}: no such file")
    if random_protocol not in PROTOCOLS:
        raise ConfigError(f"--random-protocol {shortened(random_protocol)}{nearest(random_protocol, PROTOCOLS)}")
    document = run_task(
        JUDGE,
        str(curves),
        f"--random-protocol={random_protocol}",
        *(f"--switch={switch}" for switch in switches),
        *([] if as_json else [f"--key={key}" for key in TITLES]),
    )
    shape = document["shape"]
    sizes = " x ".join(f"{shape[name]} {name}" for name in ("algorithms", "tasks", "runs", "episodes"))
    say(f"{curves}: {', '.join([sizes.replace('tasks', 'levels'), *switches])}\n", document, as_json=as_json)
    if not as_json:
        for part in judged_parts(document):
            console.print(part, markup=False, soft_wrap=isinstance(part, str))
