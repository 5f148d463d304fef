"""Does what `deploy.study.dispatcher` decides: runs as `railctl up` starts them, scores, references and the report.

Runs outlive the command that started them: the next one adopts those whose supervisors live.
"""

import json
import os
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from railctl.analysis.study import PlannedRun, Study, StudyFolder
from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder, numbered, write_atomically
from railctl.common.levels.distributions import shipped
from railctl.common.locks import holder
from railctl.common.process import Stopping
from railctl.common.requests import LevelChoice, ReferenceRequest, ScoreRequest
from railctl.common.strict import ConfigError
from railctl.deploy.commands.evaluate import SCORER
from railctl.deploy.commands.references import REFERENCE_SCORER
from railctl.deploy.follow import outcome_of
from railctl.deploy.launch import check_existing, new_run, save_config, start_supervisor
from railctl.deploy.levels import read_own
from railctl.deploy.runs import Failed, check_here, supervised
from railctl.deploy.study.dispatcher import (
    Adopted,
    Begin,
    Comparing,
    Dispatcher,
    Ended,
    Event,
    Job,
    Reporting,
    Scoring,
    Start,
    Stop,
    StopAsked,
)
from railctl.deploy.study.progress import Looking, State
from railctl.deploy.task import Task

REPORTER = "railctl.analysis.report"
TICK_S = 0.2


class View(Protocol):
    """Shows how a study goes on."""

    def show(self, mind: Dispatcher) -> None:
        """Called again and again."""

    def ended(self, job: Job, event: Ended) -> None:
        """Something is over."""


class Runner:
    """Carries out the orders for a study on this machine."""

    def __init__(  # noqa: PLR0913  (what it works with)
        self,
        folder: StudyFolder,
        study: Study,
        configs: Mapping[PlannedRun, RunConfig],
        jobs: Sequence[Job],
        bank: Path,
        view: View,
    ) -> None:
        self._folder = folder
        self._study = study
        self._configs = configs
        self._bank = bank
        self._view = view
        self._tasks: dict[Job, Task] = {}
        self.mind = Dispatcher(jobs, cores=next(iter(configs.values())).cluster.cores)
        self._at_work = True

    def run(self, stopping: Stopping) -> None:
        """Go on until nothing is left to do, or somebody asks to stop and everything has ended."""
        self._take_stock()
        self._tell(Begin())
        while self._at_work:
            if stopping.asked:
                stopping.asked = False
                self._tell(StopAsked())
            for job in self.mind.running():
                if (ended := self._end_of(job)) is not None:
                    self._tell(ended)
            self._view.show(self.mind)
            stopping.wait(TICK_S)

    def _take_stock(self) -> None:
        found = Looking(self._folder, self._study).look()
        states = {progress.run: progress.state for progress in found.runs}
        for job in list(self.mind.states):
            if self._is_done(job, states, found.references):
                self.mind.on(Ended(job, "done"))
            elif isinstance(job, PlannedRun) and supervised(self._run(job)):
                self.mind.on(Adopted(job))

    def _is_done(
        self, job: Job, states: Mapping[PlannedRun, State], references: Mapping[tuple[str, str], bool]
    ) -> bool:
        match job:
            case PlannedRun():
                return states[job] in ("trained", "done") and not supervised(self._run(job))
            case Scoring():
                return states[job.run] == "done"
            case Comparing():
                return references[job.policy, job.level]
            case Reporting():
                return False

    def _run(self, run: PlannedRun) -> RunFolder:
        return RunFolder(self._folder.run(run))

    def _tell(self, event: Event) -> None:
        if isinstance(event, Ended):
            self._view.ended(event.job, event)
        for order in self.mind.on(event):
            match order:
                case Start():
                    self._start(order.job)
                case Stop():
                    self._stop(order.job)
                case _:
                    self._at_work = False

    def _start(self, job: Job) -> None:
        try:
            match job:
                case PlannedRun():
                    self._train(job)
                case Scoring():
                    self._tasks[job] = Task(SCORER, self._scoring(job.run).model_dump_json())
                case Comparing():
                    self._tasks[job] = Task(REFERENCE_SCORER, self._comparing(job).model_dump_json())
                case Reporting():
                    self._tasks[job] = Task(REPORTER, "--study", str(self._folder.path))
        except (ConfigError, Failed, OSError) as error:
            self._tell(Ended(job, "failed", str(error)))

    def _train(self, run: PlannedRun) -> None:
        folder, config = self._run(run), self._configs[run]
        if not folder.path.exists():
            new_run(run.name, config, self._folder.runs, read_own(config.world.levels, Path()))
        else:
            if folder.config().science != config.science:
                raise Failed(f"{folder.config_file} is not what the study says: delete {folder.path} to train it anew")
            check_here(folder)
            check_existing(folder, config)
            save_config(folder, config)
        start_supervisor(folder, config, bank=self._bank)

    def _scoring(self, run: PlannedRun) -> ScoreRequest:
        path = self._run(run).checkpoints / f"{self._study.episodes:08d}.safetensors"
        return ScoreRequest(checkpoint=path, levels=self._playing(run.level))

    def _comparing(self, job: Comparing) -> ReferenceRequest:
        return ReferenceRequest(policy=job.policy, levels=self._playing(job.level))

    def _playing(self, level: str) -> LevelChoice:
        final = self._study.evaluation
        world = next(config.world for run, config in self._configs.items() if run.level == level)
        own = {level: world.levels[level]} if level not in shipped() else {}
        return LevelChoice(names=(level,), own=own, episodes=final.episodes, seed=final.seed, bank=self._bank)

    def _end_of(self, job: Job) -> Ended | None:
        """How a job ended, or none while it goes on."""
        if isinstance(job, PlannedRun):
            return None if supervised(self._run(job)) else self._end_of_run(job)
        task = self._tasks[job]
        if not task.has_ended():
            return None
        del self._tasks[job]
        try:
            document = task.result()
            if not isinstance(job, Reporting):
                self._keep(job, document)
        except (ConfigError, Failed, OSError) as error:
            return Ended(job, "failed", str(error))
        return Ended(job, "done")

    def _end_of_run(self, run: PlannedRun) -> Ended:
        folder = self._run(run)
        if not folder.outcome_file.exists():
            return Ended(run, "lost")
        outcome, reason = outcome_of(folder)
        if outcome == "finished":
            return Ended(run, "done")
        return Ended(run, "failed", reason if outcome == "failed" else f"it was {outcome}")

    def _keep(self, job: Scoring | Comparing | PlannedRun, document: dict[str, object]) -> None:
        """Save a score. A run that has been scored never goes on: what it would go on from is deleted."""
        if isinstance(job, Comparing):
            write_atomically(self._folder.reference(job.policy, job.level), json.dumps(document, indent=2))
        if isinstance(job, Scoring):
            path = Path(str(document["checkpoint"]))
            named = {"checkpoint": str(path.relative_to(self._folder.path))}  # wherever the study lies
            write_atomically(self._folder.evaluation(job.run), json.dumps(document | named, indent=2))
            for snapshot in numbered(self._run(job.run).snapshots):
                snapshot.unlink()

    def _stop(self, job: Job) -> None:
        """The first time a run ends cleanly, the second time at once."""
        if job in self._tasks:
            self._tasks[job].end()
        elif isinstance(job, PlannedRun) and (pid := holder(self._run(job), "supervisor")) is not None:
            os.kill(pid, signal.SIGTERM)
