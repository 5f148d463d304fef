"""How far a study is, read from its folder alone."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from railctl.analysis.report import archive
from railctl.analysis.study import PlannedRun, Study, StudyFolder, planned_runs
from railctl.common.folder import RunFolder
from railctl.common.locks import elsewhere, living
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import DamagedRows, each_row
from railctl.deploy.follow import outcome_of
from railctl.deploy.runs import supervised
from railctl.deploy.study.shares import Share

COMMAND = "study"  # begins the names of the locks of commands that carry out a study

State = Literal["waiting", "running", "trained", "done", "failed"]


@dataclass(frozen=True)
class RunProgress:
    """How far a run is; `trained`: its network has not been scored yet."""

    run: PlannedRun
    state: State = "waiting"
    episodes: int = 0
    reason: str = ""  # of a failure

    def document(self) -> dict[str, Any]:
        return {
            "name": self.run.name,
            **self.run._asdict(),
            "state": self.state,
            "episodes": self.episodes,
            "reason": self.reason,
        }


@dataclass(frozen=True)
class StudyProgress:
    """How far all of a study is."""

    study: Study
    runs: Sequence[RunProgress]
    references: Mapping[tuple[str, str], bool]  # (policy, level) -> whether it was scored

    def count(self, *states: State) -> int:
        return sum(run.state in states for run in self.runs)

    @property
    def episodes(self) -> int:
        return sum(run.episodes for run in self.runs)

    @property
    def is_done(self) -> bool:
        return self.count("done") == len(self.runs) and all(self.references.values())

    @property
    def failures(self) -> dict[str, str]:
        return {run.run.name: run.reason for run in self.runs if run.state == "failed"}

    def cells(self) -> dict[tuple[str, str], list[RunProgress]]:
        """The runs of each contender on each level of which there are some."""
        cells = {
            (contender.name, level): [run for run in self.runs if run.run[:2] == (contender.name, level)]
            for contender in self.study.contenders
            for level in self.study.levels
        }
        return {cell: runs for cell, runs in cells.items() if runs}


class Looking:
    """Looks at a study's folder again and again; what is over is read but once."""

    def __init__(self, folder: StudyFolder, study: Study, runs: Sequence[PlannedRun] | None = None) -> None:
        """`runs` are those to look at, if not all."""
        self._folder = folder
        self._study = study
        self._runs = list(planned_runs(study)) if runs is None else runs
        self._done: dict[PlannedRun, RunProgress] = {}
        self._scored: frozenset[tuple[str, str]] = frozenset()
        if folder.results.exists():  # of runs that were made elsewhere
            archived = archive.load(folder.results)
            self._done = {run: RunProgress(run, "done", study.episodes) for run in archived.done}
            self._scored = frozenset(archived.references)

    def look(self) -> StudyProgress:
        """The study as it is now."""
        return StudyProgress(
            self._study,
            [self._run(run) for run in self._runs],
            {
                (policy, level): (policy, level) in self._scored or self._folder.reference(policy, level).exists()
                for policy in self._study.references
                for level in self._study.levels
            },
        )

    def _run(self, run: PlannedRun) -> RunProgress:
        if run not in self._done:
            found = run_progress(self._folder, self._study, run)
            if found.state != "done":
                return found
            self._done[run] = found
        return self._done[run]


def command_of(share: Share | None) -> str:
    """The name of the lock of the command that carries out a study, or a share of it."""
    return COMMAND if share is None else f"{COMMAND}-{share.number}-of-{share.out_of}"


def commands(folder: StudyFolder) -> dict[str, int]:
    """Name and pid of the commands of this machine that carry out a study."""
    return {name: pid for name, pid in living(folder).items() if name.startswith(COMMAND)}


def run_progress(folder: StudyFolder, study: Study, run: PlannedRun) -> RunProgress:
    """How far one run is."""
    place = RunFolder(folder.run(run))
    if not place.path.exists():
        return RunProgress(run)
    outcome, reason = outcome_of(place)
    if outcome == "finished":
        state: State = "done" if folder.evaluation(run).exists() else "trained"
        return RunProgress(run, state, study.episodes)
    try:
        episodes = sum(1 for _ in each_row(place.episodes_file, EpisodeRow))
    except DamagedRows as error:
        return RunProgress(run, "failed", 0, str(error))
    if supervised(place) or elsewhere(place) is not None:
        return RunProgress(run, "running", episodes)
    return RunProgress(run, "failed", episodes, reason) if outcome == "failed" else RunProgress(run, episodes=episodes)


def status_document(folder: StudyFolder, progress: StudyProgress, time_left_s: float | None) -> dict[str, Any]:
    """What `railctl study status --json` prints."""
    return {
        "study": progress.study.name,
        "path": str(folder.path),
        "process": next(iter(commands(folder).values()), None),
        "runs_done": progress.count("done"),
        "runs_total": len(progress.runs),
        "episodes": progress.episodes,
        "episodes_total": len(progress.runs) * progress.study.episodes,
        "time_left_s": time_left_s,
        "cells": [
            {
                "contender": contender,
                "level": level,
                **{state: states[state] for state in ("done", "running", "trained", "waiting", "failed")},
                "episodes": sum(run.episodes for run in runs),
            }
            for (contender, level), runs in progress.cells().items()
            for states in [Counter(run.state for run in runs)]
        ],
        "references": [
            {"policy": policy, "level": level, "done": done} for (policy, level), done in progress.references.items()
        ],
        "runs": [run.document() for run in progress.runs],
        "report": report_of(folder),
    }


def report_of(folder: StudyFolder) -> str | None:
    """The page of the report, if there is one."""
    return next(map(str, sorted(folder.report.glob("*.html"))), None)
