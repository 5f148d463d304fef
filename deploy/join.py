"""A machine that joins a run: actors under a supervisor of their own, in a folder that goes when they end."""

import logging
import os
import re
import shutil
import socket
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from railctl.common.bus import Bus, NoAnswer, open_bus
from railctl.common.config import RunConfig
from railctl.common.folder import Cluster, RunFolder
from railctl.common.levels.bank import bank_root
from railctl.common.levels.distributions import ANY, LevelFiles
from railctl.common.levels.own import own_copy
from railctl.common.locks import sole
from railctl.common.process import Stopping
from railctl.common.records.heartbeats import Heartbeat
from railctl.common.records.joining import LevelPartRequest, RunIntroduction
from railctl.common.strict import ConfigError, nearest
from railctl.common.tls import Credentials
from railctl.common.wire import keys
from railctl.deploy.far import CONNECT_TIMEOUT_S, introduced, introduction, reach_far
from railctl.deploy.levels import prepare_levels
from railctl.deploy.plan import ProcessSpec, actors
from railctl.deploy.processes import FolderGone, Processes
from railctl.deploy.runs import Failed
from railctl.deploy.supervisor import Limits, Quit, StopAsked, Supervisor
from railctl.deploy.termination import never_missed

log = logging.getLogger(__name__)

PULL_TIMEOUT_S = 120.0  # of level files
ASK_EVERY_S = 2.0
SILENT_S = 10.0  # a run that is there beats every second
LOOK_EVERY_S = 0.5  # for a run that is not there yet
ASK_TIMEOUT_S = 1.0
MOST_NAME_CHARACTERS = 64  # of a process


class Joiner(Processes):
    """Supervises the actors of this machine until all is trained; whenever the link is cut, it waits."""

    def __init__(self, folder: RunFolder, specs: list[ProcessSpec]) -> None:
        self._address, self._namespace = folder.endpoint_and_namespace()
        self._known = False  # that the run at the other end of the link is ours
        self._heard = 0.0  # when a process of its own machine was
        self._next_look = 0.0
        self.other: str | None = None  # the run that has its place
        super().__init__(folder, Supervisor(specs, Limits.of(folder.config().cluster)))

    def connect(self, stack: ExitStack) -> Bus | None:
        """Once the run's host can be reached."""
        credentials = self._folder.credentials()
        try:
            bus = stack.enter_context(
                open_bus(self._address, self._namespace, CONNECT_TIMEOUT_S, self._inbox, credentials)
            )
        except NoAnswer:
            return None
        bus.subscribe(keys.FAR_HEARTBEATS, self._on_beat)
        bus.subscribe(keys.HEARTBEATS, self._on_beat_of_the_run)
        return bus

    def look(self) -> None:
        """Whether there is still the same run at the other end of the link, each time when it is back."""
        silent = time.monotonic() - self._heard > SILENT_S  # a link to a relay holds when that to the host does not
        if self._bus is None or not self._bus.connected() or (self._known and silent):
            if self._known:
                log.warning("no link to %s: goes on when it is back", self._address)
            self._known = False
        elif not self._known and time.monotonic() >= self._next_look:
            self._next_look = time.monotonic() + ASK_EVERY_S
            try:
                run = introduction(self._bus, self._address, ASK_TIMEOUT_S)
            except NoAnswer:
                return  # its supervisor is only starting
            log.info("linked to run %s at %s", run.name, self._address)
            self._known, self._heard = True, time.monotonic()
            if run.namespace != self._namespace:
                self.other = run.name
                self._handle(StopAsked("stopped"))

    def _on_beat_of_the_run(self, beat: Heartbeat) -> None:
        """Only processes of the run's own machine may send them."""
        self._heard = time.monotonic()
        if beat.role == "learner" and beat.state == "finished":
            self._handle(StopAsked("finished"))


def join(address: str, credentials: Credentials, counts: Mapping[str, int], patience_s: float = 0.0) -> Quit:
    """Act for the run at an address until it is trained, or somebody asks to stop.

    Args:
        address: of the run's host.
        credentials: of an actor.
        counts: how many actors, by what they serve.
        patience_s: how long to wait for a run that is not there yet.

    Raises:
        ConfigError: the run has no such levels.
        NoAnswer: it cannot be reached.
        Failed: it cannot be acted here, or another run has its place, or SIGTERM came before it was trained.
    """
    path = Path(tempfile.mkdtemp(prefix="railctl-join-"))  # which is its user's alone
    try:
        with never_missed() as came:
            _wait_for_run(address, credentials, patience_s, came)
            folder = _made(RunFolder(path / "run"), address, credentials, counts)
        stopping = Stopping()
        with sole(folder, "supervisor"):  # its actors see by this that it lives
            joiner = Joiner(folder, actors(counts, host_for(counts)))
            end = joiner.run(stopping)
    except FolderGone as gone:
        shutil.rmtree(path, ignore_errors=True)
        raise Failed(str(gone)) from None
    except BaseException:
        shutil.rmtree(path)
        raise
    if end.outcome == "failed":
        raise Failed(f"{end.reason} in {folder.path}")
    shutil.rmtree(path)
    if joiner.other is not None:
        raise Failed(f"{address} has another run now, {joiner.other}: join that one")
    if stopping.terminated and end.outcome == "stopped":
        raise Failed("SIGTERM: left the run before it was trained")
    return end


def _wait_for_run(address: str, credentials: Credentials, patience_s: float, came: Sequence[KeyboardInterrupt]) -> None:
    """Wait until a run says its name at an address, or a signal `came` that was lost.

    Raises as `introduced`, but not before patience is over.
    """
    deadline, said = time.monotonic() + patience_s, ""
    while not came:
        try:
            introduced(address, credentials)
        except NoAnswer as reason:
            if time.monotonic() >= deadline:
                raise
            if said != str(reason):
                said = str(reason)
                log.info("waits for the run: %s", reason)
            time.sleep(LOOK_EVERY_S)
        else:
            return


def _made(folder: RunFolder, address: str, credentials: Credentials, counts: Mapping[str, int]) -> RunFolder:
    """The folder, with all that actors of the run look for in it."""
    with reach_far(address, credentials) as (bus, run):
        folder.logs.mkdir(parents=True)
        folder.processes.mkdir()
        folder.config_file.write_text(run.config)
        cluster = Cluster(endpoint=address, namespace=run.namespace, keys=str(credentials.folder))
        folder.cluster_file.write_text(cluster.model_dump_json())
        config = _config(folder, run)
        for level in counts:
            if level != ANY and level not in config.mix:
                raise ConfigError(f"--actors: run {run.name} has no level {level}{nearest(level, list(config.mix))}")
        _pull_levels(folder, config, bus)
    prepare_levels(config.world.levels, bank_root(folder.path.parent), len(os.sched_getaffinity(0)))
    log.info("joins run %s at %s", run.name, address)
    return folder


def _config(folder: RunFolder, run: RunIntroduction) -> RunConfig:
    try:
        return folder.config()
    except ConfigError as error:
        raise Failed(f"run {run.name} is not one of this version: {error}") from None


def _pull_levels(folder: RunFolder, config: RunConfig, bus: Bus) -> None:
    """The run's own copies of level files, which its configuration knows by their digests."""
    for name, levels in config.world.levels.items():
        if isinstance(levels, LevelFiles):
            copy = own_copy(folder.path, name)
            copy.parent.mkdir(exist_ok=True)
            with copy.open("wb") as file:
                file.writelines(_parts(bus, name))


def _parts(bus: Bus, level: str) -> Iterator[bytes]:
    """What a run's copy of level files holds, as far as it goes if it shrinks meanwhile."""
    first = 0
    while True:
        part = bus.ask(keys.PULL_LEVELS, LevelPartRequest(level=level, first=first), PULL_TIMEOUT_S)
        yield part.content
        first += len(part.content)
        if not part.content or first >= part.total:
            return


def host_for(counts: Mapping[str, int]) -> str:
    """The name of this machine, as far as names of actors have room for it, and the process: two may join from here."""
    own = f"-{os.getpid()}"
    room = MOST_NAME_CHARACTERS - max(len(spec.name) for spec in actors(counts)) - len(own) - 1
    name = re.sub(r"[^A-Za-z0-9_.-]", "-", socket.gethostname().partition(".")[0])
    return (name[-room:] or "host") + own
