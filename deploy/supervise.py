"""python -m railctl.deploy.supervise --run FOLDER: does what `deploy.supervisor` decides; answers queries.

Processes outlive their supervisor: a new one adopts those that hold their locks and starts what is missing.
"""

import argparse
import logging
import os
from contextlib import ExitStack
from pathlib import Path

from railctl.common.bus import Bus, NoAnswer, Question, open_bus
from railctl.common.folder import Cluster, Outcome, RunFolder, write_atomically
from railctl.common.levels.own import own_copy
from railctl.common.locks import sole
from railctl.common.private import remove_endpoint
from railctl.common.process import Stopping, run_service
from railctl.common.records.control import CommandAnswer, Empty, ScaleRequest, Status
from railctl.common.records.joining import PART_BYTES, LevelPart, LevelPartRequest, RunIntroduction
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import DamagedRows, each_row
from railctl.common.wire import keys
from railctl.deploy.curve import CurveDrawing
from railctl.deploy.joined import Joined
from railctl.deploy.overview import overview, progress_of, run_is_complete
from railctl.deploy.plan import actors, cluster
from railctl.deploy.processes import FolderGone, Processes
from railctl.deploy.runs import Failed
from railctl.deploy.supervisor import Limits, StopAsked, Supervisor, Wanted

log = logging.getLogger(__name__)

CONNECT_STRETCH_S = 0.3


class Runner(Processes):
    """Supervises a run, on the machine of its router and learner."""

    def __init__(self, folder: RunFolder) -> None:
        self._config = folder.config()
        self.endpoint, self._namespace = folder.endpoint_and_namespace()
        self._counts = dict(folder.cluster().actors or {})
        self._joined = Joined(self._config.mix)
        self._drawing: CurveDrawing | None = None
        super().__init__(folder, Supervisor(cluster(self._counts), Limits.of(self._config.cluster)))

    def look(self) -> None:
        """Whether all is done."""
        self._draw_when_trained()
        if run_is_complete(self._config, self._beats):
            self._handle(StopAsked("finished"))

    def _draw_when_trained(self) -> None:
        """Get the drawing of the curve ready while the last evaluations go on."""
        progress = None if self._drawing else progress_of(self._config, self._beats)
        if progress is not None and progress.done == self._config.episodes:
            self._drawing = CurveDrawing(self._folder)

    def draw(self) -> Path:
        """Draw the curve as it is by now; raises as `CurveDrawing.finish`."""
        return (self._drawing or CurveDrawing(self._folder)).finish()

    def connect(self, stack: ExitStack) -> Bus | None:
        """Once there is a router."""
        if "router" not in self._pids:
            return None
        try:
            bus = stack.enter_context(open_bus(self.endpoint, self._namespace, CONNECT_STRETCH_S, self._inbox))
        except NoAnswer:
            return None
        bus.subscribe(keys.HEARTBEATS, self._on_beat)
        bus.subscribe(keys.FAR_HEARTBEATS, self._joined.on_beat)
        # A token that goes also ends the wait for messages: the look for exits follows at once.
        bus.watch_alive(keys.ALL_ALIVE, self._joined.on_alive)
        bus.serve(keys.RUN, self._on_run)
        bus.serve(keys.PULL_LEVELS, self._on_pull_levels)
        bus.serve(keys.STATUS, self._on_status)
        bus.serve(keys.SCALE, self._on_scale)
        bus.serve(keys.STOP, self._on_stop)
        return bus

    def _on_run(self, question: Question[Empty, RunIntroduction]) -> None:
        question.answer(
            RunIntroduction(
                name=self._folder.path.name,
                namespace=self._namespace,
                config=self._folder.config_file.read_text(),
            )
        )

    def _on_pull_levels(self, question: Question[LevelPartRequest, LevelPart]) -> None:
        path = own_copy(self._folder.path, question.request.level)
        try:
            with path.open("rb") as file:
                file.seek(question.request.first)
                part = LevelPart(content=file.read(PART_BYTES), total=path.stat().st_size)
        except OSError as error:
            question.refuse(f"{path.name}: {error.strerror}")
        else:
            question.answer(part)

    def _on_status(self, question: Question[Empty, Status]) -> None:
        question.answer(self.status())

    def _on_scale(self, question: Question[ScaleRequest, CommandAnswer]) -> None:
        wrong = [name for name in question.request.actors if name != "any" and name not in self._config.mix]
        if wrong:
            text = f"this run has no level {wrong[0]}: it has {', '.join(self._config.mix)}"
            question.answer(CommandAnswer(done=False, text=text))
            return
        counts = self._counts | question.request.actors
        kept = Cluster(endpoint=self.endpoint, namespace=self._namespace, actors=counts)
        try:
            write_atomically(self._folder.cluster_file, kept.model_dump_json(indent=2))
        except OSError as error:
            text = f"{self._folder.cluster_file}: {error.strerror}: the actors stay as they are"
            question.answer(CommandAnswer(done=False, text=text))
            return
        self._counts = counts
        text = "actors are now " + " ".join(f"{name}={count}" for name, count in counts.items())
        unserved = [level for level in self._config.mix if not (counts.get(level) or counts.get("any"))]
        if unserved and any(counts.values()):  # with none at all the learner acts
            text += f"; episodes of {', '.join(unserved)} wait for some"
        self._tell("scaled", None, text)
        question.answer(CommandAnswer(done=True, text=text))  # first: hundreds take longer to start than it waits
        self._handle(Wanted(tuple(actors(counts))))

    def _on_stop(self, question: Question[Empty, CommandAnswer]) -> None:
        again = self._mind.stopping is not None
        self._handle(StopAsked("stopped"))
        question.answer(CommandAnswer(done=True, text="ends at once" if again else "stops"))

    def status(self) -> Status:
        """The run and its processes as of now."""
        return overview(self._folder, self._config, self._mind, self._pids, self._beats, self._joined.statuses())


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
        try:
            end = runner.run(stopping)
        except FolderGone:
            remove_endpoint(runner.endpoint)
            raise
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
