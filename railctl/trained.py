"""Runs, seen from Python: started, followed, stopped; and what is in their folders."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder
from railctl.common.locks import holder, living
from railctl.common.records.rows import EpisodeRow, EvaluationRow, MetricRow
from railctl.common.rows import read_rows
from railctl.common.strict import ConfigError
from railctl.deploy.commands.run_options import base_of, without_none
from railctl.deploy.commands.up import prepare
from railctl.deploy.curve import CurveDrawing
from railctl.deploy.follow import outcome_of, wait_until
from railctl.deploy.growing import GrowingRows
from railctl.deploy.launch import start_supervisor
from railctl.deploy.resolve import merge, read_file
from railctl.deploy.runs import Failed, find_checkpoint, is_gone, supervised
from railctl.given import path_of, text_of
from railctl.policies import Policy

LOOK_S = 0.2
STOP_PATIENCE_S = 120.0
WINDOW = 100

Row = EpisodeRow | EvaluationRow


class Run:
    """A run in its folder, whoever started it, running or not.

    Attributes:
        name: as the command line knows it.
        path: its folder; the README says what is in it.
    """

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self.name, self.path = folder.path.name, folder.path

    @property
    def config(self) -> RunConfig:
        """What the run is."""
        return self._folder.config()

    @property
    def state(self) -> str:
        """`running`, or how it ended: `finished`, `stopped` or `failed`."""
        return "running" if living(self._folder) else outcome_of(self._folder)[0]

    def rows(self) -> list[EpisodeRow]:
        """A row an episode trained so far, in order: `episode`, `level`, `normalised_return`, `arrived`, ..."""
        return read_rows(self._folder.episodes_file, EpisodeRow)

    def evaluations(self) -> list[EvaluationRow]:
        """A row a checkpoint and level that was scored: `episode`, `level`, `normalised_return`, ..."""
        return read_rows(self._folder.evaluations_file, EvaluationRow)

    def metrics(self) -> list[MetricRow]:
        """A row an episode of what learning showed: `episode`, and `metrics` by name, as `loss`."""
        return read_rows(self._folder.metrics_file, MetricRow)

    def curve(self, window: int = WINDOW) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The learning curve: numbers of episodes [E], and the mean normalised return of the last `window` of them [E].

        At the start, where there are fewer, it is that of those there are.

        Raises:
            ConfigError: `window` is not a whole number of at least 1.
        """
        if not isinstance(window, int) or window < 1:
            raise ConfigError(f"window={window!r}: use a number of episodes, 1 or more")
        returns = np.array([row.normalised_return for row in self.rows()])
        sums = np.concatenate([[0.0], returns.cumsum()])
        ends = np.arange(1, len(returns) + 1)
        starts = np.maximum(0, ends - window)
        return ends, (sums[ends] - sums[starts]) / (ends - starts)

    @property
    def checkpoint(self) -> Path:
        """The file of the newest checkpoint; raises Failed if there is none yet."""
        return find_checkpoint(str(self.path.absolute()))

    def policy(self) -> Policy:
        """The policy of the newest checkpoint."""
        return Policy(self.checkpoint)

    def draw(self) -> Path:
        """Draw the learning curve as it is now; returns the picture's file."""
        return CurveDrawing(self._folder).finish()

    def follow(self) -> Iterator[Row]:
        """Every row of the run, those that are there and those that come, each once, until it ends."""
        episodes = GrowingRows(self._folder.episodes_file, EpisodeRow)
        evaluations = GrowingRows(self._folder.evaluations_file, EvaluationRow)
        goes_on = True
        while goes_on:
            goes_on = supervised(self._folder)  # asked first: what comes before the end is read
            yield from episodes.fresh()
            yield from evaluations.fresh()
            if goes_on:
                time.sleep(LOOK_S)

    def wait(self, on_row: Callable[[Row], None] | None = None) -> "Run":
        """Wait until it ends; Ctrl-C stops it cleanly, and comes through.

        Args:
            on_row: hears every row, each once.

        Raises:
            Failed: it failed, or its supervisor was killed, or its folder is gone.
        """
        try:
            for row in self.follow():
                if on_row is not None:
                    on_row(row)
        except KeyboardInterrupt:
            self.stop()
            raise
        if is_gone(self._folder):
            raise Failed(f"{self.path} is gone, and so its processes end")
        if not self._folder.outcome_file.exists():
            raise Failed(f"the supervisor of run {self.name} was killed: railctl.train(name={self.name!r}) goes on")
        outcome, reason = outcome_of(self._folder)
        if outcome == "failed":
            raise Failed(reason)
        return self

    def stop(self) -> None:
        """Stop it cleanly: the learner writes a snapshot of everything first. Nothing happens if it does not run.

        Raises:
            Failed: it takes longer than two minutes.
        """
        if (pid := holder(self._folder, "supervisor")) is not None:
            os.kill(pid, signal.SIGTERM)
        if not wait_until(lambda: not supervised(self._folder), STOP_PATIENCE_S):
            raise Failed(f"run {self.name} still runs: railctl down {self.name} --force ends it")

    def __repr__(self) -> str:
        config = self.config
        return f"Run({self.name!r}: {config.algorithm} on {', '.join(config.mix)}, {self.state})"


def start(name: str | None, run_file: Path | str | None, given: dict[str, Any], settings: dict[str, Any]) -> Run:
    """Start a run, or go on with the one of this name; see `railctl.train`."""
    file = path_of("run_file", run_file)
    told: dict[str, Any] = {} if file is None else read_file(file)
    if given["level"] is not None:
        told.pop("mix", None)
    told = merge(merge(told, without_none(given)), settings)
    folder, config = prepare(text_of("name", name), told, base_of(file))
    run = Run(folder)
    if not supervised(folder) and run.state != "finished":
        start_supervisor(folder, config, told.get("cluster", {}).get("actors"))
    return run
