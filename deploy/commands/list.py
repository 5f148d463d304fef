"""railctl list: all runs, and how far each is."""

import time

from railctl.deploy.listed import Listed, listed
from railctl.deploy.output import AsJson, console, one_line_errors, print_table, say
from railctl.deploy.runs import all_runs, runs_root
from railctl.deploy.show import duration, named_table, number

DAY_S = 86_400


@one_line_errors
def list_(as_json: AsJson = False) -> None:
    """List all runs, the newest last: state, algorithm, levels, progress, return of the last 100 episodes."""
    runs = [listed(folder) for folder in all_runs()]
    if as_json:
        say("", {"runs": [run._asdict() for run in runs]}, as_json=True)
        return
    if not runs:
        console.print(f"there are no runs in {runs_root()}: start one with railctl up", markup=False, soft_wrap=True)
        return
    table = named_table("run", "state", "algorithm", "levels", "lag", "seed", "episodes", "return(100)", "changed")
    for run in runs:
        table.add_row(*_cells(run))
    print_table(table)
    for run in runs:
        if run.problem is not None:
            console.print(f"! {run.run}: {run.problem}", markup=False, soft_wrap=True)


def _cells(run: Listed) -> list[str]:
    return [
        run.run,
        run.state,
        run.algorithm or "-",
        ", ".join(run.levels) or "-",
        "-" if run.lag is None else str(run.lag),
        "-" if run.seed is None else str(run.seed),
        "-" if run.episodes is None else f"{run.done}/{run.episodes}",
        number(run.return_last_100),
        _ago(max(0.0, time.time() - run.changed_unix_s)),
    ]


def _ago(seconds: float) -> str:
    """How long ago, in days where hours say little."""
    return f"{duration(seconds)} ago" if seconds < 2 * DAY_S else f"{seconds // DAY_S:.0f} days ago"
