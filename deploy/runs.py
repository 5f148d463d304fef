"""Finding runs on disk, and reaching their clusters."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from railctl.common.bus import Bus, NoAnswer, open_bus
from railctl.common.folder import RunFolder, numbered
from railctl.common.locks import elsewhere, holder, living
from railctl.common.strict import ConfigError, brief, check_is_text, nearest, shortened

CONNECT_TIMEOUT_S = 2.0
PRETRAINED = Path(__file__).parent / "pretrained"


class Failed(Exception):  # noqa: N818  (it ends a command)
    """A command could not do what it was asked, though it was asked correctly; the text says why and what to do."""


def runs_root() -> Path:
    """Where runs lie: $RAILCTL_RUNS, or `runs` in the working directory.

    Raises:
        ConfigError: the name of either folder is no text.
    """
    root = Path(os.environ.get("RAILCTL_RUNS", "runs"))
    check_is_text(str(root), "RAILCTL_RUNS")
    with suppress(FileNotFoundError):  # it was deleted, so nothing can be there
        check_is_text(str(Path.cwd()), "the working directory")
    return root


def all_runs() -> list[RunFolder]:
    """All runs, the newest last."""
    root = runs_root()
    if not root.is_dir():
        return []
    found = [path for path in root.iterdir() if path.name[0] != "." and _is_run(path)]
    return [RunFolder(path) for path in sorted(found, key=lambda path: (path / "config.yaml").stat().st_mtime)]


def _is_run(path: Path) -> bool:
    try:
        return (path / "config.yaml").exists()
    except PermissionError:  # somebody else's
        return False


def find_run(name: str | None) -> RunFolder:
    """The run of this name or path; without a name the newest living one, or else the newest.

    Raises:
        ConfigError: there is no such run.
    """
    known = all_runs()
    if name is None:
        if not known:
            raise ConfigError(f"there are no runs in {runs_root()}: start one with railctl up")
        return next((run for run in reversed(known) if living(run)), known[-1])
    _check_length(name)
    candidates = runs_root() / name, Path(name)
    for candidate in candidates:
        if _is_run(candidate):
            return RunFolder(candidate)
    for candidate in candidates:
        if candidate.is_dir() and not os.access(candidate, os.X_OK):
            raise ConfigError(f"{candidate} belongs to {candidate.owner()}, and nobody else may look into it")
        if (candidate / "episodes.jsonl").exists() or (candidate / "logs").is_dir():
            raise without_configuration(candidate)
    if not known:
        there = f"there are no runs in {runs_root()}, start one with railctl up"
        raise ConfigError(f"no run named {shortened(name)}: {there}")
    raise ConfigError(f"no run named {shortened(name)}{nearest(name, [run.path.name for run in known])}")


def _check_length(name: str) -> None:
    """Raise ConfigError if the system allows no path that long."""
    try:
        Path(name).exists()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise ConfigError(f"{brief(name)}: {error.strerror}: give another name or path") from None


def without_configuration(path: Path) -> ConfigError:
    """What is wrong with the folder of a run, or of something else, that has no configuration."""
    return ConfigError(f"{path} is there, without its config.yaml: restore that, or give another name")


def find_checkpoint(name: str) -> Path:
    """The checkpoint file of this path, one that ships, as `pretrained/NAME`, or the newest of the run that is named.

    Raises:
        ConfigError: there is no such file or run.
        Failed: the run has none yet.
    """
    _check_length(name)
    if Path(name).is_file():
        return Path(name)
    if Path(name).exists() and not Path(name).is_dir():
        raise ConfigError(f"{brief(name)} is no regular file: give the file of a checkpoint, or a run")
    if name.startswith(f"{PRETRAINED.name}/"):
        return _pretrained(name)
    if name.endswith(".safetensors"):
        raise ConfigError(f"{brief(name)}: no such file: the checkpoints of a run lie in its folder checkpoints")
    try:
        run = find_run(name)
    except ConfigError as error:
        raise ConfigError(f"no file {brief(name)}, and {error}") from None
    own = numbered(run.checkpoints)
    if not own:
        raise Failed(f"run {run.path.name} has no checkpoint yet: railctl checkpoint {run.path.name} writes one")
    return own[-1]


def pretrained() -> list[str]:
    """The names of the checkpoints that ship."""
    return sorted(f"{PRETRAINED.name}/{path.stem}" for path in PRETRAINED.glob("*.safetensors"))


def _pretrained(name: str) -> Path:
    if name not in (known := pretrained()):
        raise ConfigError(f"{brief(name)}: no such checkpoint ships{nearest(name, known)}")
    return PRETRAINED / f"{name.partition('/')[2]}.safetensors"


def supervised(folder: RunFolder) -> bool:
    """Whether a supervisor looks after the run right now."""
    return holder(folder, "supervisor") is not None


def is_gone(folder: RunFolder) -> bool:
    """Whether the folder of a run that had a supervisor was deleted or moved: the supervisor's lock stays in it."""
    return not (folder.processes / "supervisor").exists()


def runs_elsewhere(folder: RunFolder) -> str | None:
    """What to say of a run whose processes are on another machine or in another container that shares its folder."""
    host = elsewhere(folder)
    return None if host is None else f"run {folder.path.name} runs on {host}: ask there"


def check_here(folder: RunFolder) -> None:
    """Raises Failed for a run whose processes are elsewhere: nobody here can steer them or take them over."""
    if (said := runs_elsewhere(folder)) is not None:
        raise Failed(f"{said}, or stop it there first")


@contextmanager
def reach(folder: RunFolder) -> Iterator[Bus]:
    """The bus of a run's cluster.

    Raises:
        NoAnswer: the cluster is not there.
    """
    endpoint, namespace = folder.endpoint_and_namespace()
    if not living(folder):
        raise NoAnswer(runs_elsewhere(folder) or _why_nothing_runs(folder))
    with open_bus(endpoint, namespace, CONNECT_TIMEOUT_S) as bus:
        yield bus


def _why_nothing_runs(folder: RunFolder) -> str:
    """What to say of a run that has no process."""
    name, outcome = folder.path.name, folder.outcome()
    if outcome is not None and outcome.outcome == "finished":
        return f"run {name} is finished: start another one with railctl up"
    return f"run {name} is not running: railctl up --name {name} resumes it"
