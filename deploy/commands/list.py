"""railctl list: all runs, and how far each is."""

import time
from typing import NamedTuple

from railctl.common.folder import RunFolder
from railctl.common.locks import living
from railctl.common.recent import RECENT_EPISODES, mean_of
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import DamagedRows, last_rows
from railctl.common.strict import ConfigError
from railctl.deploy.follow import outcome_of
from railctl.deploy.output import AsJson, console, one_line_errors, print_table, say
from railctl.deploy.runs import all_runs, runs_root
from railctl.deploy.show import duration, named_table, number

DAY_S = 86_400


class Listed(NamedTuple):
    """A run in the list; what its files do not say is None."""

    run: str
    state: str
    algorithm: str | None
    levels: list[str]
    lag: int | str | None
    seed: int | None
    done: int | None
    episodes: int | None
    return_last_100: float | None
    changed_unix_s: float
    problem: str | None = None


@one_line_errors
def list_(as_json: AsJson = False) -> None:
    """List all runs, the newest last: state, algorithm, levels, progress, return of the last 100 episodes."""
    runs = [_listed(folder) for folder in all_runs()]
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


def _listed(folder: RunFolder) -> Listed:
    """A run as its files say; nobody is asked, so that a hundred runs take no longer than a glance."""
    file = folder.episodes_file if folder.episodes_file.exists() else folder.config_file
    changed = file.stat().st_mtime
    try:
        config = folder.config()
        done, recent = last_rows(folder.episodes_file, EpisodeRow, RECENT_EPISODES)
    except (ConfigError, DamagedRows) as error:
        return Listed(folder.path.name, "unreadable", None, [], None, None, None, None, None, changed, str(error))
    return Listed(
        run=folder.path.name,
        state=_state(folder),
        algorithm=config.algorithm,
        levels=list(config.mix),
        lag=config.lag,
        seed=config.seed,
        done=done,
        episodes=config.episodes,
        return_last_100=mean_of(row.normalised_return for row in recent),
        changed_unix_s=changed,
    )


def _state(folder: RunFolder) -> str:
    alive = living(folder)
    if not alive:
        return outcome_of(folder)[0]
    if "supervisor" not in alive:
        return "unsupervised"
    return "paused" if folder.paused_file.exists() else "running"


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
