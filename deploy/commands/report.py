"""railctl report: figures and tables on runs, side by side, as one page."""

from pathlib import Path
from typing import Annotated, Any

import typer

from deploy.output import AsJson, one_line_errors, say
from deploy.runs import find_run
from deploy.task import run_task

REPORTER = "services.evaluator.report"


@one_line_errors
def report(
    runs: Annotated[
        list[str] | None, typer.Argument(metavar="RUN...", help="Names or folders of runs; default: the newest.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where it goes; default: report, in the run's folder if it is one."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare runs: their training curves, reliability, last scores and settings, on a page that needs nothing else."""
    result = _on_runs(runs or [None], output)
    states = ", ".join(f"{count} {state}" for state, count in result["runs"].items())
    text = f"{result['figures']} figures and {result['tables']} tables on runs: {states}\nreport   {result['report']}"
    say(text, result, as_json=as_json)


def _on_runs(names: list[str] | list[None], output: Path | None) -> dict[str, Any]:
    folders = [find_run(name).path for name in names]
    folder = output or (folders[0] / "report" if len(folders) == 1 else Path("report"))
    return run_task(REPORTER, *(part for run in folders for part in ("--run", str(run))), "--output", str(folder))
