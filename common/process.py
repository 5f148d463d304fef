"""What every process of a run shares: one of a name, clean ends, logs, heartbeats, and its place in the run's folder."""

import fcntl
import json
import logging
import os
import signal
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml

from common.bus import Bus, NoAnswer, open_bus
from common.config import ConfigError, RunConfig, parse_config
from common.records import Heartbeat, Role
from common.wire.keys import HEARTBEATS, Alive

log = logging.getLogger(__name__)

HEARTBEAT_EVERY_S = 1.0
EXIT_FATAL = 3  # starting this process again cannot help: its supervisor stops the run and shows the last line
STRETCH_S = 0.05
LOCK_PATIENCE_S = 2.0  # a probe by another process holds the lock for an instant


class Fatal(Exception):  # noqa: N818  (it ends a process)
    """Something that a restart cannot mend; the text names it and the remedy."""


@dataclass(frozen=True)
class RunFolder:
    """Where everything of a run lies."""

    path: Path

    @property
    def config_file(self) -> Path:
        return self.path / "config.yaml"

    @property
    def episodes_file(self) -> Path:
        return self.path / "episodes.jsonl"

    @property
    def evaluations_file(self) -> Path:
        return self.path / "evaluations.jsonl"

    @property
    def checkpoints(self) -> Path:
        return self.path / "checkpoints"

    @property
    def snapshots(self) -> Path:
        return self.path / "snapshots"

    @property
    def logs(self) -> Path:
        return self.path / "logs"

    @property
    def processes(self) -> Path:
        return self.path / "processes"

    @property
    def cluster_file(self) -> Path:
        return self.path / "cluster.json"

    @property
    def outcome_file(self) -> Path:
        return self.path / "outcome.json"

    @property
    def paused_file(self) -> Path:
        return self.path / "paused"

    def config(self) -> RunConfig:
        """The run's checked configuration.

        Raises:
            ConfigError: the file is missing or wrong.
        """
        try:
            data = yaml.safe_load(self.config_file.read_text())
        except (OSError, yaml.YAMLError) as error:
            raise ConfigError(f"{self.config_file} cannot be read: {error}") from None
        try:
            return parse_config(data if isinstance(data, dict) else {})
        except ConfigError as error:
            raise ConfigError(f"{self.config_file}: {error}") from None

    def endpoint_and_namespace(self) -> tuple[str, str]:
        """Where the run's router listens, and the run's key prefix.

        Raises:
            NoAnswer: the run was never started.
        """
        try:
            cluster = json.loads(self.cluster_file.read_text())
            return str(cluster["endpoint"]), str(cluster["namespace"])
        except (OSError, ValueError, KeyError):
            raise NoAnswer(f"run {self.path.name} has no cluster: start one with railctl up") from None


def write_atomically(path: Path, text: str) -> None:
    """Replace a file in one step, so that nobody ever reads half of it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(text)
    temporary.replace(path)


@contextmanager
def sole(folder: RunFolder, name: str) -> Iterator[None]:
    """Be the only process of this name in the run, for as long as the block lasts; the kernel frees a dead one's lock.

    Raises:
        Fatal: another process has the name.
    """
    folder.processes.mkdir(exist_ok=True)
    with (folder.processes / name).open("a+") as file:
        deadline = time.monotonic() + LOCK_PATIENCE_S
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise Fatal(f"{name} of run {folder.path.name} runs already, as process {holder(folder, name)}") from None
                time.sleep(0.02)
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield


def holder(folder: RunFolder, name: str) -> int | None:
    """The pid of the living process of this name, whoever started it, or none."""
    try:
        with (folder.processes / name).open("r") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                content = file.read()
                return int(content) if content.isdigit() else None
    except FileNotFoundError:
        pass
    return None


def living(folder: RunFolder) -> dict[str, int]:
    """Name and pid of every living process of the run."""
    if not folder.processes.is_dir():
        return {}
    pids = {path.name: holder(folder, path.name) for path in sorted(folder.processes.iterdir())}
    return {name: pid for name, pid in pids.items() if pid is not None}


class Stopping:
    """Turns SIGTERM and SIGINT into a flag that loops look at, and that ends their waits."""

    def __init__(self) -> None:
        self.asked = False  # not an Event: setting one in a handler can deadlock with the wait that it interrupts
        signal.signal(signal.SIGTERM, self._on_signal)
        signal.signal(signal.SIGINT, self._on_signal)

    def _on_signal(self, _number: int, _frame: object) -> None:
        self.asked = True

    def wait(self, seconds: float) -> None:
        """Wait, but not beyond the moment when somebody asks to stop."""
        deadline = time.monotonic() + seconds
        while not self.asked and (left := deadline - time.monotonic()) > 0:
            time.sleep(min(left, STRETCH_S))


class Heart:
    """Publishes a sign of life, at most one a second, from the process's own loop."""

    def __init__(self, bus: Bus, name: str, role: Role) -> None:
        self._bus = bus
        self._name = name
        self._role = role
        self._next = 0.0

    def beat(self, state: str, counters: Callable[[], dict[str, float]] = dict, *, now: bool = False) -> None:
        """Tell what this process does; `now` also when the last beat was just before."""
        if not now and time.monotonic() < self._next:
            return
        self._next = time.monotonic() + HEARTBEAT_EVERY_S
        self._bus.publish(
            HEARTBEATS,
            Heartbeat(process=self._name, role=self._role, pid=os.getpid(), state=state, counters=counters()),
        )


@dataclass(frozen=True)
class Place:
    """A process's place in its run."""

    folder: RunFolder
    config: RunConfig
    name: str
    incarnation: str
    bus: Bus
    heart: Heart
    stopping: Stopping


@contextmanager
def take_place(folder: RunFolder, name: str, role: Role) -> Iterator[Place]:
    """Join the run as the only process of this name: configuration, bus, liveliness token, heartbeat."""
    stopping = Stopping()
    with sole(folder, name):
        config = folder.config()
        endpoint, namespace = folder.endpoint_and_namespace()
        incarnation = uuid.uuid4().hex[:16]
        with open_bus(endpoint, namespace) as bus:
            bus.declare_alive(Alive(role, name, incarnation))
            heart = Heart(bus, name, role)
            heart.beat("starting")
            log.info("%s started as process %d", name, os.getpid())
            yield Place(folder, config, name, incarnation, bus, heart, stopping)
            log.info("%s ends", name)


def run_service(main: Callable[[], None]) -> None:
    """Run a service's main with a log on stderr; what cannot be mended by a restart ends with `EXIT_FATAL`."""
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s"
    )
    try:
        main()
    except (Fatal, ConfigError) as error:
        log.error("%s", error)  # noqa: TRY400  (the text is the whole story)
        sys.exit(EXIT_FATAL)
