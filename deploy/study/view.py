"""How a study looks in a terminal, and in the lines of a log."""

import time
from collections import Counter
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from railctl.analysis.study import PlannedRun, Study, StudyFolder
from railctl.deploy.show import duration, named_table
from railctl.deploy.study.dispatcher import Dispatcher, Ended, Job
from railctl.deploy.study.estimate import Cell, Rate, measured, seconds_left
from railctl.deploy.study.progress import Looking, StudyProgress

REFRESH_S = 1.0
LINE_EVERY_S = 30.0


def headline(progress: StudyProgress, time_left_s: float | None) -> str:
    """A study in one line."""
    total = len(progress.runs)
    left = f", {duration(time_left_s)} left" if time_left_s else ""
    failed = f", {progress.count('failed')} failed" if progress.count("failed") else ""
    return (
        f"{progress.count('done')} of {total} runs done{failed}, "
        f"{progress.episodes} of {total * progress.study.episodes} episodes{left}"
    )


def cell_table(progress: StudyProgress) -> Table:
    """How many runs of each contender on each level are how far."""
    table = named_table("contender", "level")
    for name in ("done", "running", "waiting", "failed", "episodes"):
        table.add_column(name, justify="right")
    for (contender, level), runs in progress.cells().items():
        states = Counter(run.state for run in runs)
        table.add_row(
            contender,
            level,
            f"{states['done']}/{len(runs)}",
            str(states["running"] or "-"),
            str((states["waiting"] + states["trained"]) or "-"),
            Text(str(states["failed"] or "-"), style="bold red" if states["failed"] else ""),
            str(sum(run.episodes for run in runs)),
        )
    return table


class StudyView:
    """The view of a study that goes on: live in a terminal, a line now and then elsewhere."""

    def __init__(
        self,
        folder: StudyFolder,
        study: Study,
        cores: int,
        console: Console,
        runs: Sequence[PlannedRun] | None = None,
    ) -> None:
        """`runs` are those that it is about, if not all."""
        self._looking = Looking(folder, study, runs)
        self._folder = folder
        self._study = study
        self._cores = cores
        self._console = console
        self._rates: dict[Cell, Rate] = {}
        self._rates_are_of = -1  # so many runs
        self._due = 0.0
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def say(self, text: str) -> None:
        self._console.print(text, markup=False, soft_wrap=True)

    def ended(self, job: Job, event: Ended) -> None:
        """Say what is over."""
        again = {"lost": "its supervisor is gone: taken up again", "failed": event.reason}.get(event.outcome, "")
        done = "trained" if isinstance(job, PlannedRun) and event.outcome == "done" else event.outcome
        self.say(f"{job.name}: {again or done}")

    def show(self, mind: Dispatcher) -> None:
        """Show where the study is, but not all the time."""
        if time.monotonic() < self._due:
            return
        self._due = time.monotonic() + (LINE_EVERY_S if self._live is None else REFRESH_S)
        progress = self._looking.look()
        left = self._time_left(progress)
        if self._live is None:
            doing = ", ".join(job.name for job in mind.running())
            self.say(f"{headline(progress, left)}; {'stopping' if mind.stopping else 'now'} {doing}")
        else:
            self._live.update(self._panel(progress, left, mind), refresh=True)

    def _time_left(self, progress: StudyProgress) -> float | None:
        over = progress.count("done", "trained")
        if over != self._rates_are_of:  # reading takes a while
            self._rates, self._rates_are_of = measured(self._folder, progress), over
        return seconds_left(progress, self._rates, self._cores)

    def _panel(self, progress: StudyProgress, left: float | None, mind: Dispatcher) -> RenderableType:
        bar = Table.grid()  # a bar does not end its line
        bar.add_row(ProgressBar(len(progress.runs) * self._study.episodes, progress.episodes, width=60))
        parts: list[RenderableType] = [Text(headline(progress, left)), bar, cell_table(progress)]
        episodes = {run.run: run.episodes for run in progress.runs}
        for job in mind.running():
            far = f"  {episodes[job]}/{self._study.episodes} episodes" if isinstance(job, PlannedRun) else ""
            parts.append(Text(f"{'stopping' if mind.stopping else 'now':8} {job.name}{far}"))
        parts += [Text(f"! {job.name}: {reason}", style="yellow") for job, reason in mind.failures.items()]
        return Panel(
            Group(*parts), title=f"study {self._study.name}", subtitle="Ctrl-C stops cleanly", expand=False, width=108
        )
