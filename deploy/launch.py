"""From a checked configuration to a supervised cluster. Every check comes before the first file or process."""

import os
import re
import shutil
import subprocess
import time
import uuid
from collections import deque
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

from railctl.common.checkpoint import CheckpointError
from railctl.common.config import RunConfig
from railctl.common.folder import Cluster, RunFolder, write_atomically
from railctl.common.interpreter import run_module
from railctl.common.levels.distributions import ANY
from railctl.common.levels.own import LEVELS, ReadLevels
from railctl.common.locks import living
from railctl.common.plain_yaml import dump_yaml
from railctl.common.private import FOLDER_MODE, is_private, private_endpoint, private_files
from railctl.common.records.joining import NAMESPACE_PATTERN
from railctl.common.records.rows import EpisodeRow, EvaluationRow, EventRow, MetricRow
from railctl.common.rows import DamagedRows, each_row
from railctl.common.rules.settings import DEMONSTRATIONS_FILE, START_FILE
from railctl.common.snapshots import check_history, newest_snapshot
from railctl.common.strict import ConfigError, shortened
from railctl.common.tls import Credentials
from railctl.deploy.certificates import check as check_credentials
from railctl.deploy.demonstrations import copy_demonstrations
from railctl.deploy.listening import check_free
from railctl.deploy.plan import ENVIRONMENT
from railctl.deploy.runs import Failed, runs_root, supervised, without_configuration
from railctl.deploy.start import copy_start

NAME_FORM = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,99}")
NAMESPACE_FORM = re.compile(NAMESPACE_PATTERN)
START_TIMEOUT_S = 60.0  # importing takes long on a machine that is busy
_supervisors: list[subprocess.Popen[bytes]] = []  # of this process, which may end before them, or long after


def fresh_name(config: RunConfig) -> str:
    """A name for a run that was given none."""
    levels = "-".join(config.mix)[:40]  # a mix may have many
    stem = f"{config.algorithm}-{levels}-seed{config.seed}-{datetime.now():%Y%m%d-%H%M%S}"  # noqa: DTZ005  (the user's clock)
    name, number = stem, 2
    while (runs_root() / name).exists():
        name, number = f"{stem}-{number}", number + 1
    return name


def new_run(
    name: str,
    config: RunConfig,
    root: Path | None = None,
    own: Mapping[str, ReadLevels] = MappingProxyType({}),
    base: Path = Path(),
) -> RunFolder:
    """Make the folder of a new run, with its copies of what it needs of other files, whole or not at all.

    Args:
        name: of the run.
        config: what it does.
        root: the folder that it shall lie in; None: beside all other runs.
        own: what its level files hold, by the name of the distribution.
        base: where the paths of the checkpoint and of the demonstrations start that it begins with.

    Raises:
        ConfigError, Failed: as `check_new`, or the folder cannot be made.
    """
    check_new(name, config, root)
    path = (root or runs_root()) / name
    temporary = path.with_name(f".{name}.{os.getpid()}")
    try:
        temporary.parent.mkdir(parents=True, exist_ok=True)
        with private_files():
            temporary.mkdir()
            save_config(RunFolder(temporary), with_own_copies(config))
            (temporary / "logs").mkdir()
            for level, read in own.items():
                read.save(temporary / LEVELS, level)
            copy_start(config, base, RunFolder(temporary).start_file)
            copy_demonstrations(config, base, RunFolder(temporary).demonstrations_file)
        temporary.rename(path)
    except Failed:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        raise Failed(
            f"cannot create {path}: {error.strerror}: set RAILCTL_RUNS to a folder that you may write"
        ) from None
    return RunFolder(path)


def with_own_copies(config: RunConfig) -> RunConfig:
    """The configuration of a run that begins with files, once it has its own copies of them beside it."""
    learning, own = config.learning, dict[str, Any]()
    if (start := learning.begins_with) is not None:
        own["start_from"] = start.model_copy(update={"checkpoint": START_FILE})
    if (shown := learning.demonstrated) is not None:
        own["demonstrations"] = shown.model_copy(update={"file": DEMONSTRATIONS_FILE})
    return config.model_copy(update={"learning": learning.model_copy(update=own)}) if own else config


def check_new(name: str, config: RunConfig, root: Path | None = None) -> None:
    """See that a run can begin, beside all other runs or in `root`, before anything is started or changed.

    Raises:
        ConfigError: the name is not one, or taken.
        Failed: this machine cannot run it.
    """
    check_name(name)
    path = (root or runs_root()) / name
    if (path / "config.yaml").exists():
        raise ConfigError(f"{path} exists already: give another --name")
    if path.exists():
        raise without_configuration(path)
    check_machine(config)
    check_listening(config)


def check_name(name: str) -> None:
    """Raises ConfigError if no run can have this name."""
    if not NAME_FORM.fullmatch(name):
        raise ConfigError(f"--name {shortened(name)}: use letters, digits, '.', '_', '+' and '-', at most 100")


def check_existing(folder: RunFolder, config: RunConfig) -> None:
    """See that a run can go on before anything is started or changed.

    Raises:
        Failed: this machine cannot run it, its folder is read-only or has other things in it than it should, a row is
            damaged, or no snapshot of it can be read, or the newest is of another configuration or of rows that are
            not there.
    """
    check_machine(config)
    check_door(folder, config)
    if not os.access(folder.path, os.W_OK):
        raise Failed(f"cannot write to {folder.path}: make it writable, or copy the run to another folder")
    _check_places(folder)
    _check_cluster(folder, config)
    try:
        for path, kind in (
            (folder.episodes_file, EpisodeRow),
            (folder.evaluations_file, EvaluationRow),
            (folder.metrics_file, MetricRow),
            (folder.events_file, EventRow),
        ):
            deque(each_row(path, kind), maxlen=0)
        if (newest := newest_snapshot(folder, config)) is not None:
            check_history(folder.episodes_file, each_row(folder.episodes_file, EpisodeRow), newest.metadata)
    except (CheckpointError, DamagedRows) as error:
        raise Failed(str(error)) from None


def _check_places(folder: RunFolder) -> None:
    """Raises Failed if something else lies where the run has a folder or a file."""
    for path in (folder.checkpoints, folder.snapshots, folder.tensorboard, folder.processes, folder.logs):
        if os.path.lexists(path) and not path.is_dir():
            raise Failed(f"{path} is no folder: move it away")
    for path in (
        folder.episodes_file,
        folder.evaluations_file,
        folder.metrics_file,
        folder.events_file,
        folder.board_file,
        folder.cluster_file,
        folder.outcome_file,
        folder.paused_file,
        folder.curve_file,
        *folder.logs.glob("*.log"),
    ):
        if os.path.lexists(path) and not path.is_file():
            raise Failed(f"{path} is no regular file: move it away")


def _check_cluster(folder: RunFolder, config: RunConfig) -> None:
    """Raises Failed if `cluster.json` says of the run what no run has, or not this one."""
    cluster = folder.cluster()
    if cluster.namespace is not None and NAMESPACE_FORM.fullmatch(cluster.namespace) is None:
        wrong = f"{folder.cluster_file}: namespace {shortened(cluster.namespace)}"
        raise Failed(f"{wrong} is not railctl/ and hexadecimal digits: restore it, or delete the file")
    for name in cluster.actors or {}:
        if name != ANY and name not in config.mix:
            known = ", ".join(config.mix)
            raise Failed(
                f"{folder.cluster_file}: actors for level {name}, which this run does not have: "
                f"it has {known}, leave the others out"
            )


def check_machine(config: RunConfig) -> None:
    """Raises Failed if the machine lacks the cores."""
    cores = len(os.sched_getaffinity(0))
    if config.cluster.cores > cores:
        raise Failed(f"cluster.cores is {config.cluster.cores} and this machine offers {cores}: use --cores {cores}")


def check_door(folder: RunFolder, config: RunConfig) -> None:
    """See that other machines will find a run where its configuration says, also if it is running already.

    Raises:
        ConfigError, Failed: as `check_listening`, or its router listens elsewhere as long as it lives.
    """
    before, now = folder.config().cluster, config.cluster
    if not living(folder).keys() & {"supervisor", "router"}:
        check_listening(config)
    elif (before.listen, before.keys) != (now.listen, now.keys):
        name = folder.path.name
        raise Failed(f"run {name} is running, and its router listens elsewhere: railctl down {name} first")


def check_listening(config: RunConfig) -> None:
    """See that a router can listen for other machines, if it shall.

    Raises:
        ConfigError: a file of its keys cannot be used.
        Failed: it cannot listen there.
    """
    listen, folder = config.cluster.listen, config.cluster.keys
    if listen is None or folder is None:
        return
    check_credentials(Credentials(Path(folder), "host"))
    check_free("cluster.listen", listen)


def save_config(folder: RunFolder, config: RunConfig) -> None:
    """Write the resolved configuration."""
    text = dump_yaml(config.plain())
    write_atomically(folder.config_file, text)


def start_supervisor(
    folder: RunFolder,
    config: RunConfig,
    actors: Mapping[str, int] | None = None,
    bank: Path | None = None,
) -> int:
    """Start the supervisor of a run that has none; it takes over processes that live. Returns its pid.

    Actors are those that are asked for, or else as many as there were. Without a bank it is that beside the run.

    Raises:
        Failed: it ended at once.
        KeyboardInterrupt: came meanwhile; the supervisor has ended, too.
    """
    folder.path.chmod(FOLDER_MODE)  # those of earlier versions were open to others
    with private_files():
        write_cluster_file(folder, config, actors)
        folder.logs.mkdir(exist_ok=True)
        log = folder.logs / "supervisor.log"
        log.touch()
    with log.open("ab") as output:
        folder.outcome_file.unlink(missing_ok=True)  # once nothing but the start itself can fail
        child = subprocess.Popen(
            run_module("railctl.deploy.supervise", "--run", str(folder.path.resolve())),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=os.environ | ENVIRONMENT | ({} if bank is None else {"RAILCTL_LEVELS": str(bank.resolve())}),
            start_new_session=True,
        )
    _supervisors[:] = [*(before for before in _supervisors if before.poll() is None), child]
    try:
        _wait_for(child, folder, log)
    except BaseException:  # Ctrl-C, above all: who asked for the run does not want it any more
        child.terminate()
        child.wait()
        raise
    return child.pid


def _wait_for(supervisor: subprocess.Popen[bytes], folder: RunFolder, log: Path) -> None:
    """Wait until it supervises the run; raises Failed."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while not supervised(folder):
        if supervisor.poll() is not None or time.monotonic() > deadline:
            lines = log.read_text(errors="replace").splitlines() or ["it left no word"]
            raise Failed(f"the supervisor did not start: {lines[-1]}")
        time.sleep(0.05)


def write_cluster_file(folder: RunFolder, config: RunConfig, actors: Mapping[str, int] | None = None) -> None:
    """Fix where the router listens, the run's key prefix, and how many actors there are.

    What lives stays reachable, a run keeps its prefix, and it has as many actors as before unless others are asked for.
    """
    before = folder.cluster()
    there = before.endpoint if living(folder) or is_private(before.endpoint or "") else None
    cluster = Cluster(
        endpoint=there or private_endpoint(),
        namespace=before.namespace or f"railctl/{uuid.uuid4().hex[:12]}",
        actors=next(counts for counts in (actors, before.actors, config.cluster.actors) if counts is not None),
    )
    write_atomically(folder.cluster_file, cluster.model_dump_json(indent=2))
