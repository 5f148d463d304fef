"""The processes of a run on this machine: started, heard, ended, as a `Supervisor` decides."""

import logging
import os
import signal
import subprocess
import time
from abc import ABC, abstractmethod
from contextlib import ExitStack

from railctl.common.bus import Bus
from railctl.common.folder import RunFolder
from railctl.common.inbox import Inbox
from railctl.common.locks import holder, living
from railctl.common.process import EXIT_FATAL, EXIT_RUNS_ALREADY, STARTING, Fatal, Stopping
from railctl.common.records.heartbeats import Heartbeat
from railctl.common.records.rows import EventKind
from railctl.deploy.events import DamagedSnapshots, EventLog, changes
from railctl.deploy.plan import ENVIRONMENT, ProcessSpec
from railctl.deploy.supervisor import (
    Adopted,
    Beat,
    Event,
    Exited,
    Happening,
    Kill,
    Launch,
    Quit,
    StopAsked,
    Supervisor,
    Terminate,
    Tick,
)

log = logging.getLogger(__name__)

TICK_S = 0.1
LAST_WORDS_CHARACTERS = 300


class FolderGone(Fatal):
    """Somebody deleted or moved the folder of a run that lives."""


class Processes(ABC):
    """Carries out the orders of a mind for one run on this machine."""

    def __init__(self, folder: RunFolder, mind: Supervisor) -> None:
        self._folder = folder
        self._opened = os.open(folder.path, os.O_RDONLY | os.O_DIRECTORY)  # so that no other one can be taken for it
        self._mind = mind
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._pids: dict[str, int] = {}
        self._beats: dict[str, tuple[Heartbeat, float]] = {}
        self._events = EventLog(folder)
        self._damaged = DamagedSnapshots(folder)
        self._inbox = Inbox()
        self._bus: Bus | None = None
        self._log_starts: dict[str, int] = {}
        self._quit: Quit | None = None
        signal.signal(signal.SIGCHLD, lambda *_: self._inbox.put(lambda: None))  # ends the wait for messages

    @abstractmethod
    def connect(self, stack: ExitStack) -> Bus | None:
        """The run's bus, which takes what arrives to the inbox, with all that is subscribed; None: not yet."""

    @abstractmethod
    def look(self) -> None:
        """What is to be seen to now and then."""

    def run(self, stopping: Stopping) -> Quit:
        """Take over what lives, and supervise until the run is finished, stopped or failed.

        Raises:
            FolderGone: there is no run any more; its processes are killed, for they could keep nothing.
        """
        with ExitStack() as stack:
            stack.callback(self._events.close)
            self._tell("started", "supervisor", f"supervisor started as process {os.getpid()}")
            for name, pid in living(self._folder).items():
                if name != "supervisor":
                    self._adopt(name, pid)
            self._handle(Tick(connected=False))  # starts what is missing
            while self._quit is None:
                try:
                    self._go_on(stopping, stack)
                except FileNotFoundError:
                    stopping.wait(TICK_S)  # a deletion takes its time
                    if not self._is_gone():
                        raise
                if self._is_gone():
                    for name in self._pids:
                        self._signal(name, signal.SIGKILL)
                    raise FolderGone(f"{self._folder.path} is gone, and so its processes have ended")
            outcome, reason = self._quit.outcome, self._quit.reason
            self._tell(outcome, None, f"{outcome}: {reason}" if reason else outcome)
            return self._quit

    def _go_on(self, stopping: Stopping, stack: ExitStack) -> None:
        if stopping.asked:
            stopping.asked = False
            self._handle(StopAsked("stopped"))
        if self._bus is None:
            self._bus = self.connect(stack)
        self._inbox.take(TICK_S)
        self._look_for_exits()
        self.look()
        self._handle(Tick(connected=self._connected()))

    def _is_gone(self) -> bool:
        """Somebody has deleted or moved the folder, or is at it; another one may be in its place."""
        try:
            is_there = os.path.samestat(self._folder.path.stat(), os.fstat(self._opened))
        except FileNotFoundError:
            return True
        return not (is_there and self._folder.logs.is_dir() and self._folder.processes.is_dir())

    def _connected(self) -> bool:
        return self._bus is not None and self._bus.connected()

    def _look_for_exits(self) -> None:
        for name in list(self._pids):
            child = self._children.get(name)
            code = None if child is None else child.poll()
            if code is None and (child is not None or holder(self._folder, name) is not None):
                continue
            if child is None and not (self._folder.processes / name).exists():
                continue  # its lock stays when it ends: somebody is deleting the folder
            self._children.pop(name, None)
            del self._pids[name]
            if code == EXIT_RUNS_ALREADY and (pid := holder(self._folder, name)) is not None:
                self._adopt(name, pid)  # an earlier supervisor's, which had not taken its place yet
            else:
                self._handle(Exited(name, code, last_words(self._folder, name, code, self._log_starts.get(name, 0))))

    def _adopt(self, name: str, pid: int) -> None:
        log.info("takes over %s, process %d", name, pid)
        self._tell("adopted", name, f"{name} taken over, process {pid}")
        self._pids[name] = pid
        self._handle(Adopted(name))

    def _on_beat(self, beat: Heartbeat) -> None:
        """Heartbeats are only believed of own processes."""
        if self._pids.get(beat.process) != beat.pid:
            return  # none of ours, or one that is gone
        before, _ = self._beats.get(beat.process, (None, 0.0))
        for happening in (*changes(before, beat), *self._damaged.new()):
            self._events.write(happening)
        self._beats[beat.process] = (beat, time.time())
        self._handle(Beat(beat.process, starts=beat.state == STARTING))

    def _handle(self, event: Event) -> None:
        orders = self._mind.on(event, time.monotonic())
        for happening in self._mind.take_story():
            self._events.write(happening)
        for order in orders:
            match order:
                case Launch():
                    self._launch(order.spec)
                case Terminate():
                    self._signal(order.process, signal.SIGTERM)
                case Kill():
                    self._signal(order.process, signal.SIGKILL)
                case Quit():
                    self._quit = order

    def _launch(self, spec: ProcessSpec) -> None:
        try:
            child = self._start(spec)
        except FileNotFoundError:
            raise  # the folder is gone
        except OSError as error:  # no room, or a limit of processes or files: as if it had died at once
            self._handle(Exited(spec.name, None, f"it cannot be started: {error.strerror}"))
            return
        log.info("started %s as process %d", spec.name, child.pid)
        self._tell("started", spec.name, f"{spec.name} started as process {child.pid}")
        self._children[spec.name] = child
        self._pids[spec.name] = child.pid

    def _start(self, spec: ProcessSpec) -> "subprocess.Popen[bytes]":
        with (self._folder.logs / f"{spec.name}.log").open("ab") as output:
            self._log_starts[spec.name] = output.tell()
            return subprocess.Popen(
                spec.command(self._folder.path),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=os.environ | ENVIRONMENT,
                start_new_session=True,
            )

    def _tell(self, kind: EventKind, process: str | None, text: str) -> None:
        self._events.write(Happening(kind, process, text))

    def _signal(self, process: str, number: signal.Signals) -> None:
        pid = self._pids.get(process)
        if pid is not None:
            log.info("sends %s to %s, process %d", number.name, process, pid)
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                log.info("%s is gone already", process)


def last_words(folder: RunFolder, name: str, code: int | None, start: int = 0) -> str:
    """The last error in a process's log from byte `start` on, or its last line, short.

    Who ends with `EXIT_FATAL` has logged why. Where that is missing there was no room for it, as for all else.
    """
    try:
        with (folder.logs / f"{name}.log").open("rb") as file:
            file.seek(start)
            lines = file.read().decode(errors="replace").splitlines()[-50:]
    except OSError:
        lines = []
    errors = [line.split(": ", 1)[1] for line in lines if " ERROR " in line and ": " in line]
    if code == EXIT_FATAL and not errors:
        return f"it could not even write its log: make room, then railctl up --name {folder.path.name} goes on"
    words = (errors or lines or [""])[-1]
    return words[:LAST_WORDS_CHARACTERS]
