"""python -m deploy.supervise --run FOLDER: does what `deploy.supervisor` decides; answers `status`, `scale`, `stop`.

Processes outlive their supervisor: a new one adopts those that hold their locks and starts what is missing.
"""

import argparse
import logging
import os
import signal
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path

from common.bus import Bus, NoAnswer, Question, open_bus
from common.folder import Cluster, Outcome, RunFolder, write_atomically
from common.inbox import Inbox
from common.locks import holder, living, sole
from common.private import remove_endpoint
from common.process import EXIT_RUNS_ALREADY, STARTING, Stopping, run_service
from common.records.control import CommandAnswer, Empty, ScaleRequest, Status
from common.records.heartbeats import Heartbeat
from common.records.rows import EpisodeRow, EventKind
from common.rows import DamagedRows, each_row
from common.wire import keys
from deploy.curve import CurveDrawing
from deploy.events import DamagedSnapshots, EventLog, changes
from deploy.overview import overview, progress_of, run_is_complete
from deploy.plan import ENVIRONMENT, ProcessSpec, actors, cluster
from deploy.runs import Failed
from deploy.supervisor import (
    Adopted,
    Beat,
    Event,
    Exited,
    Happening,
    Kill,
    Launch,
    Limits,
    Quit,
    StopAsked,
    Supervisor,
    Terminate,
    Tick,
    Wanted,
)

log = logging.getLogger(__name__)

TICK_S = 0.1
CONNECT_STRETCH_S = 0.3
LAST_WORDS_CHARACTERS = 300


class Runner:
    """Carries out the orders for one run on this machine."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._config = folder.config()
        self.endpoint, self._namespace = folder.endpoint_and_namespace()
        self._counts = dict(folder.cluster().actors or {})
        limits = self._config.cluster
        self._mind = Supervisor(
            cluster(self._counts),
            Limits(limits.hang_timeout_s, limits.max_restarts, limits.restart_window_s),
        )
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._pids: dict[str, int] = {}
        self._beats: dict[str, tuple[Heartbeat, float]] = {}
        self._events = EventLog(folder)
        self._damaged = DamagedSnapshots(folder)
        self._inbox = Inbox()
        self._bus: Bus | None = None
        self._log_starts: dict[str, int] = {}
        self._quit: Quit | None = None
        self._drawing: CurveDrawing | None = None
        signal.signal(signal.SIGCHLD, lambda *_: self._inbox.put(lambda: None))  # ends the wait for messages

    def run(self, stopping: Stopping) -> Quit:
        """Supervise until the run is finished, stopped or failed."""
        with ExitStack() as stack:
            stack.callback(self._events.close)
            self._tell("started", "supervisor", f"supervisor started as process {os.getpid()}")
            for name, pid in living(self._folder).items():
                if name != "supervisor":
                    self._adopt(name, pid)
            self._handle(Tick(connected=False))  # starts what is missing
            while self._quit is None:
                if stopping.asked:
                    stopping.asked = False
                    self._handle(StopAsked("stopped"))
                self._connect(stack)
                self._inbox.take(TICK_S)
                self._look_for_exits()
                self._draw_when_trained()
                if run_is_complete(self._config, self._beats):
                    self._handle(StopAsked("finished"))
                self._handle(Tick(connected=self._bus is not None and self._bus.connected()))
            outcome, reason = self._quit.outcome, self._quit.reason
            self._tell(outcome, None, f"{outcome}: {reason}" if reason else outcome)
            return self._quit

    def _draw_when_trained(self) -> None:
        """Get the drawing of the curve ready while the last evaluations go on."""
        progress = None if self._drawing else progress_of(self._config, self._beats)
        if progress is not None and progress.done == self._config.episodes:
            self._drawing = CurveDrawing(self._folder)

    def draw(self) -> Path:
        """Draw the curve as it is by now; raises as `CurveDrawing.finish`."""
        return (self._drawing or CurveDrawing(self._folder)).finish()

    def _connect(self, stack: ExitStack) -> None:
        if self._bus is not None or "router" not in self._pids:
            return
        try:
            bus = stack.enter_context(open_bus(self.endpoint, self._namespace, CONNECT_STRETCH_S, self._inbox))
        except NoAnswer:
            return
        bus.subscribe(keys.HEARTBEATS, self._on_beat)
        # A token that goes only ends the wait for messages: the look for exits follows at once.
        bus.watch_alive(keys.ALL_ALIVE, lambda _alive, _there: None)
        bus.serve(keys.STATUS, self._on_status)
        bus.serve(keys.SCALE, self._on_scale)
        bus.serve(keys.STOP, self._on_stop)
        self._bus = bus

    def _look_for_exits(self) -> None:
        for name in list(self._pids):
            child = self._children.get(name)
            code = None if child is None else child.poll()
            if code is None and (child is not None or holder(self._folder, name) is not None):
                continue
            self._children.pop(name, None)
            del self._pids[name]
            if code == EXIT_RUNS_ALREADY and (pid := holder(self._folder, name)) is not None:
                self._adopt(name, pid)  # an earlier supervisor's, which had not taken its place yet
            else:
                self._handle(Exited(name, code, last_words(self._folder, name, self._log_starts.get(name, 0))))

    def _adopt(self, name: str, pid: int) -> None:
        log.info("takes over %s, process %d", name, pid)
        self._tell("adopted", name, f"{name} taken over, process {pid}")
        self._pids[name] = pid
        self._handle(Adopted(name))

    def _on_beat(self, beat: Heartbeat) -> None:
        if self._pids.get(beat.process) != beat.pid:
            return  # none of ours, or one that is gone
        before, _ = self._beats.get(beat.process, (None, 0.0))
        for happening in (*changes(before, beat), *self._damaged.new()):
            self._events.write(happening)
        self._beats[beat.process] = (beat, time.time())
        if beat.state != STARTING:
            self._handle(Beat(beat.process))

    def _on_status(self, question: Question[Empty, Status]) -> None:
        question.answer(self.status())

    def _on_scale(self, question: Question[ScaleRequest, CommandAnswer]) -> None:
        wrong = [name for name in question.request.actors if name != "any" and name not in self._config.mix]
        if wrong:
            text = f"this run has no level {wrong[0]}: it has {', '.join(self._config.mix)}"
            question.answer(CommandAnswer(done=False, text=text))
            return
        counts = self._counts = self._counts | question.request.actors
        kept = Cluster(endpoint=self.endpoint, namespace=self._namespace, actors=counts)
        write_atomically(self._folder.cluster_file, kept.model_dump_json(indent=2))
        self._handle(Wanted(tuple(actors(counts))))
        text = "actors are now " + " ".join(f"{name}={count}" for name, count in counts.items())
        unserved = [level for level in self._config.mix if not (counts.get(level) or counts.get("any"))]
        if unserved and any(counts.values()):  # with none at all the learner acts
            text += f"; episodes of {', '.join(unserved)} wait for some"
        self._tell("scaled", None, text)
        question.answer(CommandAnswer(done=True, text=text))

    def _on_stop(self, question: Question[Empty, CommandAnswer]) -> None:
        again = self._mind.stopping is not None
        self._handle(StopAsked("stopped"))
        question.answer(CommandAnswer(done=True, text="ends at once" if again else "stops"))

    def status(self) -> Status:
        """The run and its processes as of now."""
        return overview(self._folder, self._config, self._mind, self._pids, self._beats)

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
        with (self._folder.logs / f"{spec.name}.log").open("ab") as output:
            self._log_starts[spec.name] = output.tell()
            child = subprocess.Popen(
                spec.command(self._folder.path),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=os.environ | ENVIRONMENT,
                start_new_session=True,
            )
        log.info("started %s as process %d", spec.name, child.pid)
        self._tell("started", spec.name, f"{spec.name} started as process {child.pid}")
        self._children[spec.name] = child
        self._pids[spec.name] = child.pid

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


def last_words(folder: RunFolder, name: str, start: int = 0) -> str:
    """The last error in a process's log from byte `start` on, or its last line, short."""
    try:
        with (folder.logs / f"{name}.log").open("rb") as file:
            file.seek(start)
            lines = file.read().decode(errors="replace").splitlines()[-50:]
    except OSError:
        return ""
    errors = [line.split(": ", 1)[1] for line in lines if " ERROR " in line and ": " in line]
    words = (errors or lines or [""])[-1]
    return words[:LAST_WORDS_CHARACTERS]


def main() -> None:
    parser = argparse.ArgumentParser(description="The supervisor of a run.")
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    folder = RunFolder(parser.parse_args().run)
    stopping = Stopping()
    with sole(folder, "supervisor"):
        runner = Runner(folder)
        cores = sorted(os.sched_getaffinity(0))[: folder.config().cluster.cores]
        os.sched_setaffinity(0, cores)
        log.info("supervises %s on cores %s", folder.path.name, cores)
        end = runner.run(stopping)
        remove_endpoint(runner.endpoint)
        log.info("run %s: %s", end.outcome, end.reason)
        outcome = Outcome(outcome=end.outcome, reason=end.reason)
        write_atomically(folder.outcome_file, outcome.model_dump_json())
        try:
            if next(each_row(folder.episodes_file, EpisodeRow), None):
                log.info("drew %s", runner.draw())
        except (DamagedRows, Failed) as error:
            log.warning("%s", error)


if __name__ == "__main__":
    run_service(main)
