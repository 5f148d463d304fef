"""What every process of a run shares: clean ends, a log, heartbeats, and a name that it has alone."""

import gc
import logging
import os
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from railctl.common.bus import Bus, NoAnswer, open_bus
from railctl.common.compile_signs import COMPILING, around_compiling
from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder
from railctl.common.inbox import Inbox
from railctl.common.locks import RunsAlreadyError, holder, sole
from railctl.common.parent import end_with_parent
from railctl.common.private import OTHERS
from railctl.common.records.base import Role
from railctl.common.records.heartbeats import Heartbeat, Report
from railctl.common.room import NO_ROOM
from railctl.common.strict import ConfigError
from railctl.common.wire.keys import FAR_HEARTBEATS, HEARTBEATS, Alive, Topic

log = logging.getLogger(__name__)

HEARTBEAT_EVERY_S = 1.0
STARTING = "starting"  # the state before the heavy imports, which take seconds without a beat
EXIT_FATAL = 3  # starting this process again cannot help: its supervisor stops the run and shows the last line
EXIT_RUNS_ALREADY = 4  # another process has the name: its supervisor looks after that one instead
STRETCH_S = 0.05
CONNECT_STRETCH_S = 5.0
SWITCH_S = 0.0005  # a message that arrives while Python works is taken up after this, not after 5 ms
OBJECTS_A_COLLECTION = 50_000  # the default, 700, has imports pass through all that is loaded over and over
COMPILE_PATIENCE_S = 600.0  # a function that takes longer to compile, with all that it calls, hangs


class Fatal(Exception):  # noqa: N818  (it ends a process)
    """Something that a restart cannot mend; the text names it and the remedy."""


class Stopped(Exception):  # noqa: N818  (not an error)
    """Somebody asked to stop in the middle of an episode."""


class Stopping:
    """Turns SIGTERM and SIGINT into a flag that loops look at, and that ends their waits."""

    def __init__(self) -> None:
        self.asked = False  # not an Event: setting one in a handler can deadlock with the wait that it interrupts
        self.terminated = False  # by SIGTERM, which is no user's way
        signal.signal(signal.SIGTERM, self._on_signal)
        signal.signal(signal.SIGINT, self._on_signal)

    def _on_signal(self, number: int, _frame: object) -> None:
        self.asked = True
        self.terminated = self.terminated or number == signal.SIGTERM

    def wait(self, seconds: float) -> None:
        """Wait, but not beyond the moment when somebody asks to stop."""
        deadline = time.monotonic() + seconds
        while not self.asked and (left := deadline - time.monotonic()) > 0:
            time.sleep(min(left, STRETCH_S))


class HeartbeatPublisher:
    """Publishes a sign of life, at most one a second, from the process's own loop, or for it while that compiles."""

    def __init__(self, bus: Bus, lock: Path, role: Role, topic: Topic[Heartbeat] = HEARTBEATS) -> None:
        """`lock` is the file of the process's name, which stays for as long as there is a run."""
        self._bus = bus
        self._lock = lock
        self._role = role
        self._topic = topic
        self._next = 0.0
        self._state = STARTING
        self._last_report: Report | None = None

    def beat(self, state: str, report: Callable[[], Report | None] = lambda: None, *, now: bool = False) -> None:
        """Say what this process does; `now` also when the last beat was just before.

        Raises:
            Fatal: the run's folder is gone, and its supervisor perhaps as well, which would see to that.
        """
        if not now and time.monotonic() < self._next:
            return
        check_there(self._lock)
        self._state, self._last_report = state, report()
        self._publish(state)

    def beat_on(self) -> None:
        """Say the same as last time: of who is at one thing for long, and gets on with it."""
        if time.monotonic() >= self._next:
            self._publish(self._state)

    @contextmanager
    def while_compiling(self, _function: str) -> Iterator[None]:
        """Beat from a thread: the loop stands still while its process compiles."""
        ended = threading.Event()

        def beats() -> None:
            deadline = time.monotonic() + COMPILE_PATIENCE_S
            while not ended.wait(max(0.0, self._next - time.monotonic())) and time.monotonic() < deadline:
                self._publish(COMPILING)

        thread = threading.Thread(target=beats, name="beats while compiling", daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def _publish(self, state: str) -> None:
        self._next = time.monotonic() + HEARTBEAT_EVERY_S
        self._bus.publish(
            self._topic,
            Heartbeat(process=self._lock.name, role=self._role, pid=os.getpid(), state=state, report=self._last_report),
        )


def check_there(lock: Path) -> None:
    """Raises Fatal if the folder of a run was deleted or moved, which the file of a process's name shows."""
    if not lock.exists():
        raise Fatal(f"{lock.parents[1]} is gone, and so {lock.name} ends")


@dataclass(frozen=True)
class ServiceContext:
    """What a process of a run works with."""

    folder: RunFolder
    config: RunConfig
    name: str
    incarnation: str
    bus: Bus
    heartbeat: HeartbeatPublisher
    stopping: Stopping


@contextmanager
def service_context(folder: RunFolder, name: str, role: Role, inbox: Inbox | None = None) -> Iterator[ServiceContext]:
    """Join the run as the only process of this name; see `join`."""
    stopping = Stopping()
    with sole(folder, name), join(folder, name, role, stopping, inbox) as context:
        yield context


@contextmanager
def join(
    folder: RunFolder, name: str, role: Role, stopping: Stopping, inbox: Inbox | None = None
) -> Iterator[ServiceContext]:
    """Join the run, having the name's lock: configuration, bus (see there for `inbox`), liveliness token, heartbeat.

    Raises:
        Fatal: whoever started it is gone, and nobody else would end it, or the run's folder is; or, inside, a file of
            the run could not be written for want of room.
    """
    config = folder.config()
    endpoint, namespace = folder.endpoint_and_namespace()
    credentials = folder.credentials()
    if credentials is not None:  # nobody else on this machine would end it
        end_with_parent(signal.SIGTERM)
        if holder(folder, "supervisor") != os.getppid():
            raise Fatal(f"{name}: whoever started it is gone")
    incarnation, lock = uuid.uuid4().hex[:16], folder.processes / name
    with ExitStack() as stack:
        while True:
            try:
                bus = stack.enter_context(open_bus(endpoint, namespace, CONNECT_STRETCH_S, inbox, credentials))
                break
            except NoAnswer:
                if stopping.asked:  # which nothing looks at while a link is tried
                    sys.exit()
                check_there(lock)
        bus.declare_alive(Alive(role, name, incarnation))
        heartbeat = HeartbeatPublisher(bus, lock, role, HEARTBEATS if credentials is None else FAR_HEARTBEATS)
        stack.enter_context(around_compiling(heartbeat.while_compiling))
        heartbeat.beat(STARTING)
        log.info("%s started as process %d", name, os.getpid())
        try:
            yield ServiceContext(folder, config, name, incarnation, bus, heartbeat, stopping)
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            remedy = f"make room, then railctl up --name {folder.path.name} goes on"
            raise Fatal(f"{folder.path}: {error.strerror}: {remedy}") from None
        log.info("%s ends", name)


def run_service(main: Callable[[], None]) -> None:
    """Run a service's main with a log on stderr, and leave; what cannot be mended by a restart ends with `EXIT_FATAL`.

    What ends well leaves at once: taking an interpreter with torch apart takes longer than a second, of every run.
    """
    os.umask(OTHERS)
    sys.setswitchinterval(SWITCH_S)
    gc.set_threshold(OBJECTS_A_COLLECTION)
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    try:
        main()
    except RunsAlreadyError as error:
        log.warning("%s", error)
        sys.exit(EXIT_RUNS_ALREADY)
    except (Fatal, ConfigError) as error:
        log.error("%s", error)  # noqa: TRY400  (the text is the whole story)
        sys.exit(EXIT_FATAL)
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
