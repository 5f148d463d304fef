"""A run in a list of runs, as its files say."""

from typing import NamedTuple

from railctl.common.folder import RunFolder
from railctl.common.locks import elsewhere, living
from railctl.common.recent import RECENT_EPISODES, mean_of
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import DamagedRows, last_rows
from railctl.common.strict import ConfigError
from railctl.deploy.follow import outcome_of


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


def listed(folder: RunFolder) -> Listed:
    """A run as its files say; nobody is asked, so that a hundred runs take no longer than a glance."""
    file = folder.episodes_file if folder.episodes_file.exists() else folder.config_file
    changed = file.stat().st_mtime
    try:
        config = folder.config()
        done, recent = last_rows(folder.episodes_file, EpisodeRow, RECENT_EPISODES)
        state = state_of(folder)
    except (ConfigError, DamagedRows, OSError) as error:
        problem = f"{error.filename}: {error.strerror}: restore it" if isinstance(error, OSError) else str(error)
        return Listed(folder.path.name, "unreadable", None, [], None, None, None, None, None, changed, problem)
    return Listed(
        run=folder.path.name,
        state=state,
        algorithm=config.algorithm,
        levels=list(config.mix),
        lag=config.lag,
        seed=config.seed,
        done=done,
        episodes=config.episodes,
        return_last_100=mean_of(row.normalised_return for row in recent),
        changed_unix_s=changed,
    )


def state_of(folder: RunFolder) -> str:
    """What its locks and files say of a run."""
    alive = living(folder)
    if not alive and elsewhere(folder) is None:
        return outcome_of(folder)[0]
    if alive and "supervisor" not in alive:
        return "unsupervised"
    return "paused" if folder.paused_file.exists() else "running"
