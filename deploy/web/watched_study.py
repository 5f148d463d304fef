"""A whole study that is watched, from its folder: how far it is, and the curves of its contenders on every level."""

import re
from collections.abc import Sequence
from statistics import median
from typing import Any

import numpy as np

from railctl.analysis.study import PlannedRun, Study, StudyFolder, read_study
from railctl.common.folder import RunFolder
from railctl.common.rows import DamagedRows
from railctl.common.strict import ConfigError
from railctl.deploy.growing import GrowingFile
from railctl.deploy.study.progress import Looking, RunProgress, StudyProgress, status_document
from railctl.deploy.web.looker import Looker
from railctl.deploy.web.scores import references_of, scored
from railctl.deploy.web.thinning import block_size, blocks

LOOK_EVERY_S = 3.0
BLOCKS = 60  # of a run's curve
RETURN = re.compile(rb'"return":(-?[0-9.]+(?:e-?[0-9]+)?)[,}]')
TELL_EVERY_RUNS = 20  # while all are read for the first time


def return_of(line: bytes) -> float:
    """The return of a row, without the rest of it: a study has some hundred thousand rows, and others check them.

    >>> return_of(b'{"episode":0,"return":-0.25,"arrived":2}')
    -0.25

    Raises:
        ValueError: there is none.
    """
    found = RETURN.search(line)
    if found is None:
        raise ValueError("no return")
    return float(found[1])


class RunReturns:
    """The returns of a run so far."""

    def __init__(self, folder: RunFolder) -> None:
        self._rows = GrowingFile(folder.episodes_file, return_of)
        self._returns: list[float] = []

    def read(self) -> np.ndarray[Any, np.dtype[np.float32]]:
        """All of them; [N]."""
        if self._rows.was_cut():
            self._rows.restart()
            self._returns = []
        self._returns += self._rows.new()
        return np.array(self._returns, np.float32)


class WatchedStudy(Looker):
    """Keeps one part, `study`."""

    kind = "study"

    def __init__(self, name: str, folder: StudyFolder) -> None:
        super().__init__(name)
        self._folder = folder
        self._looking: tuple[Study, Looking] | None = None
        self._returns: dict[PlannedRun, RunReturns] = {}
        self._curves: dict[PlannedRun, list[float]] = {}
        self._over: set[PlannedRun] = set()  # whose curve is whole
        self._scores: dict[PlannedRun, dict[str, Any]] = {}

    def look(self) -> None:
        """Look once, and wait."""
        try:
            if self._looking is None:
                study = read_study(self._folder.study_file)
                self._looking = study, Looking(self._folder, study)
            study, looking = self._looking
            progress = looking.look()
            self._read(study, progress)
        except (ConfigError, DamagedRows, OSError) as error:
            self.tell("study", {"name": self.name, "wrong": str(error)})
        self.pause(LOOK_EVERY_S)

    def _read(self, study: Study, progress: StudyProgress) -> None:
        read = 0
        for run in progress.runs:
            if run.run in self._over or not run.episodes:
                continue
            if self.ended:
                return
            self._read_run(study, run)
            read += 1
            if read % TELL_EVERY_RUNS == 0:
                self._show(study, progress)
        self._show(study, progress)

    def _read_run(self, study: Study, progress: RunProgress) -> None:
        run = progress.run
        returns = self._returns.setdefault(run, RunReturns(RunFolder(self._folder.run(run))))
        self._curves[run] = blocks(returns.read(), block_size(study.episodes, BLOCKS))
        if progress.state == "done":
            score = scored(self._folder.evaluation(run), run.level)
            if score is not None:
                self._scores[run] = score
        if progress.state in ("done", "failed"):
            self._over.add(run)
            del self._returns[run]

    def _show(self, study: Study, progress: StudyProgress) -> None:
        size = block_size(study.episodes, BLOCKS)
        document = status_document(self._folder, progress, None)
        places = {run.run: f"{self._folder.path.name}/runs/{run.run.name}" for run in progress.runs}
        known = {run.run: self._folder.run(run.run).exists() for run in progress.runs}
        self.tell(
            "study",
            {
                "name": self.name,
                **{key: document[key] for key in ("runs_done", "runs_total", "episodes", "episodes_total", "process")},
                "read": len(self._curves),
                "contenders": [contender.name for contender in study.contenders],
                "levels": list(study.levels),
                "seeds": list(study.seeds),
                "episodes_each": study.episodes,
                "block": size,
                "final_levels": study.evaluation.episodes,
                "cells": [
                    {
                        "contender": contender,
                        "level": level,
                        "curve": spread([self._curves.get(run.run, []) for run in runs], size),
                        "final": _final([self._scores[run.run] for run in runs if run.run in self._scores]),
                        "runs": [
                            {
                                "seed": run.run.seed,
                                "state": run.state,
                                "episodes": run.episodes,
                                "reason": run.reason,
                                "place": places[run.run] if known[run.run] else None,
                                "final": self._scores.get(run.run, {}).get("mean"),
                            }
                            for run in runs
                        ],
                    }
                    for (contender, level), runs in progress.cells().items()
                ],
                "references": {level: references_of(self._folder, level) for level in study.levels},
            },
        )


def spread(curves: Sequence[Sequence[float]], size: int) -> list[tuple[int, float, float, float, int]]:
    """The median of curves of blocks, with the least and the greatest; where fewer curves go on, of those.

    Returns:
        Of each block: the episode at its end, median, least, greatest, and of how many curves.

    >>> spread([[-1.0, -0.5], [-0.8]], 10)
    [(10, -0.9, -1.0, -0.8, 2), (20, -0.5, -0.5, -0.5, 1)]
    """
    found = []
    for at in range(max((len(curve) for curve in curves), default=0)):
        values = [curve[at] for curve in curves if len(curve) > at]
        found.append(
            ((at + 1) * size, round(median(values), 4), min(values), max(values), len(values)),
        )
    return found


def _final(scores: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """The scores of the last networks of a cell: median over seeds, least and greatest."""
    if not scores:
        return None
    means = [score["mean"] for score in scores]
    return {"median": median(means), "low": min(means), "high": max(means), "runs": len(means)}
