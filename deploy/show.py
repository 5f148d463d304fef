"""What a run looks like in a terminal."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Column, Table
from rich.text import Text

from railctl.common.records.control import Status
from railctl.common.records.rows import EpisodeRow, EvaluationRow, EventRow
from railctl.deploy.view import RunView, Tone, run_view

SHOWN_EVALUATIONS = 8
BLOCKS = 10
SCORE = "flatland score"  # of levels of the stock rules
TONE_STYLES: Mapping[Tone, str] = {"good": "green", "waits": "yellow", "wrong": "bold red", "idle": ""}


def view(status: Status, evaluations: Sequence[EvaluationRow]) -> RenderableType:
    """The live view: progress, evaluations, who is alive, what is wrong."""
    shown = run_view(status, time.time())
    parts: list[RenderableType] = [_progress(shown)]
    if evaluations:
        parts.append(evaluation_table(evaluations[-SHOWN_EVALUATIONS:]))
    parts.append(_processes(shown))
    parts += [Text(f"! {problem}", style="yellow") for problem in shown.problems]
    return Panel(Group(*parts), title=f"railctl  {shown.run}", subtitle="Ctrl-C stops cleanly", expand=False, width=108)


def _progress(shown: RunView) -> RenderableType:
    progress = shown.progress
    if progress is None:
        return Text(shown.starting)
    grid = Table.grid(padding=(0, 2))
    bar = ProgressBar(total=shown.episodes, completed=progress.done, width=40)
    left = f"{duration(shown.time_left_s)} left" if shown.time_left_s else ""
    grid.add_row(
        Text(shown.state, style=TONE_STYLES[shown.tone]),
        bar,
        f"{progress.done}/{shown.episodes} episodes",
        left,
    )
    line = (
        f"return of the last 100: {number(progress.return_last_100)}    "
        f"{progress.episodes_per_s:.1f} episodes/s  {progress.steps_per_s:.0f} steps/s    "
        f"{progress.leased} leased  {progress.waiting} waiting    "
        f"snapshot {progress.snapshot}"
    )
    if progress.staleness_last_100:
        line += f"\nstaleness of the last 100: {progress.staleness_last_100:.1f}"
    return Group(grid, Text(line))


def progress_line(status: Status) -> str:
    """The live view in one line, for logs and pipes."""
    shown = run_view(status, time.time())
    progress = shown.progress
    if progress is None:
        return shown.starting
    left = f"  {duration(shown.time_left_s)} left" if shown.time_left_s else ""
    stale = f"  staleness(100) {progress.staleness_last_100:.1f}" if progress.staleness_last_100 else ""
    return (
        f"{shown.state}  {progress.done}/{shown.episodes} episodes  return(100) {number(progress.return_last_100)}"
        f"{stale}  {progress.episodes_per_s:.1f} ep/s  {progress.evaluations}/{progress.evaluations_due} evaluations  "
        f"{shown.alive} processes{left}"
    )


def named_table(*headings: str) -> Table:
    """A table without lines that cuts no name short: what is too long for its column goes on in the next line."""
    table = Table(*_whole(headings), box=None, pad_edge=False)
    for column in table.columns:
        column.min_width = len(str(column.header))
    return table


def _whole(headings: Sequence[str]) -> list[Column]:
    return [Column(heading, overflow="fold") for heading in headings]


def process_table(status: Status) -> Table:
    """Who is alive, and since when silent."""
    return _processes(run_view(status, time.time()))


def _processes(shown: RunView) -> Table:
    table = named_table("process", "serves", "pid", "state", "restarts", "last heartbeat")
    for process in shown.processes:
        table.add_row(
            process.process,
            process.serves,
            str(process.pid or "-"),
            process.state,
            str(process.restarts),
            "-" if process.silent_s is None else f"{process.silent_s:.0f} s ago",
        )
    return table


def evaluation_table(rows: Sequence[EvaluationRow]) -> Table:
    """Checkpoints and their scores."""
    scored = scored_column(rows)
    has_scores = any(row.score is not None for row in rows)
    headings = ("checkpoint", "level", scored, "trains arrived", "all arrived", "steps")
    table = named_table(*headings, *([SCORE] * has_scores))
    for row in rows:
        table.add_row(
            str(row.episode),
            row.level,
            f"{row.normalised_return:.3f}",
            f"{row.arrived_share:.0%}",
            f"{row.all_arrived_share:.0%}",
            f"{row.mean_steps:.0f}",
            *([number(row.score)] * has_scores),
        )
    return table


def scored_column(rows: Sequence[EvaluationRow]) -> str:
    """The heading over scores; all rows of a run have the same mode."""
    return f"{rows[0].mode if rows else 'evaluated'} return"


def score_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """What `services.evaluator.score` found: a row a group of levels."""
    table = named_table("level")
    has_scores = any(row["score"] is not None for row in rows)
    headings = ("levels", "return", "low", "high", "median", "std", "trains\narrived", "all\narrived", "steps")
    for name in (*headings, *(["flatland\nscore"] * has_scores)):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            row["level"],
            str(row["levels"]),
            number(row["mean"]),
            number(row["low"]),
            number(row["high"]),
            number(row["median"]),
            number(row["std"]),
            f"{row['arrived_share']:.1%}",
            f"{row['all_arrived_share']:.1%}",
            f"{row['mean_steps']:.1f}",
            *([number(row["score"])] * has_scores),
        )
    return table


def summary(episodes: Sequence[EpisodeRow], evaluations: Sequence[EvaluationRow]) -> Table:
    """A whole run: blocks of episodes beside the evaluation at their end."""
    scored = scored_column(evaluations)
    headings = ("episodes", "training return", "trains arrived", "steps", scored, "all arrived")
    table = Table(*_whole(headings), title="Summary")
    size = max(1, -(-len(episodes) // BLOCKS))
    mixed = len({row.level for row in evaluations}) > 1
    for first in range(0, len(episodes), size):
        block = episodes[first : first + size]
        end = block[-1].episode + 1
        within = [row for row in evaluations if block[0].episode < row.episode <= end]
        last = [row for row in within if row.episode == within[-1].episode]
        table.add_row(
            f"{block[0].episode + 1}-{end}",
            f"{mean([row.normalised_return for row in block]):.3f}",
            f"{sum(row.arrived for row in block) / sum(row.trains for row in block):.0%}",
            f"{mean([row.steps for row in block]):.0f}",
            ", ".join(f"{row.level} " * mixed + f"{row.normalised_return:.3f}" for row in last),
            ", ".join(f"{row.level} " * mixed + f"{row.all_arrived_share:.0%}" for row in last),
        )
    return table


def row_line(row: EpisodeRow | EvaluationRow) -> str:
    """A row of a tail."""
    if isinstance(row, EpisodeRow):
        staleness = f"  staleness {row.staleness}" if row.staleness else ""
        return (
            f"episode {row.episode:>6}  {row.level:<6}  return {row.normalised_return:7.3f}  "
            f"arrived {row.arrived}/{row.trains}  steps {row.steps:>3}  epsilon {row.epsilon:.3f}  {row.actor}"
            f"{staleness}"
        )
    return (
        f"checkpoint {row.episode:>3}  {row.level:<6}  {row.mode} {row.normalised_return:7.3f}  "
        f"arrived {row.arrived_share:.0%}  all arrived {row.all_arrived_share:.0%}  steps {row.mean_steps:.0f}"
        f"{'' if row.score is None else f'  score {row.score:.3f}'}"
    )


def event_line(event: EventRow) -> str:
    """An event, with the time in UTC."""
    return f"{event.time[:10]} {event.time[11:19]}Z  {event.text}"


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def duration(seconds: float) -> str:
    """Hours, minutes and seconds.

    >>> duration(3725)
    '1:02:05'
    >>> duration(65)
    '1:05'
    """
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
