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
    stale = progress.staleness_last_100
    lines = (
        f"return of the last 100: {number(progress.return_last_100)}    "
        f"{progress.episodes_per_s:.1f} episodes/s  {progress.steps_per_s:.0f} steps/s\n"
        f"{progress.leased} leased  {progress.waiting} waiting    snapshot {progress.snapshot}"
        f"{f'    staleness of the last 100: {stale:.1f}' if stale else ''}"
    )
    return Group(grid, Text(lines))


def progress_line(status: Status, width: int | None = None) -> str:
    """The live view in one line, for logs and pipes; of at most so many characters, if what matters most has room."""
    shown = run_view(status, time.time())
    progress = shown.progress
    if progress is None:
        return shown.starting
    stale, left = progress.staleness_last_100, shown.time_left_s
    return fitted(
        [
            (shown.state, 0),
            (f"{progress.done}/{shown.episodes} episodes", 0),
            (f"return(100) {number(progress.return_last_100)}", 0),
            (f"staleness(100) {stale:.1f}" if stale else "", 0),
            (f"{progress.episodes_per_s:.1f} ep/s", 0),
            (f"{progress.evaluations}/{progress.evaluations_due} evaluations", 1),
            (f"{shown.alive} processes", 2),
            (f"{duration(left)} left" if left else "", 0),
        ],
        width,
    )


def fitted(parts: Sequence[tuple[str, int]], width: int | None) -> str:
    """A line of parts, of at most so many characters: those of the highest rank are left out first, of rank 0 none.

    >>> fitted([("episode 7", 0), ("epsilon 0.1", 2), ("actor-easy-0", 1)], 30)
    'episode 7  actor-easy-0'
    """
    kept = [(text, rank) for text, rank in parts if text]
    while width is not None and len(_joined(kept)) > width and (least := max(rank for _, rank in kept)):
        kept.remove(next(part for part in reversed(kept) if part[1] == least))
    return _joined(kept)


def _joined(parts: Sequence[tuple[str, int]]) -> str:
    return "  ".join(text for text, _ in parts)


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


def row_line(row: EpisodeRow | EvaluationRow, width: int | None = None) -> str:
    """A row of a tail, of at most so many characters, if what matters most has room; names are never cut."""
    if isinstance(row, EpisodeRow):
        return fitted(
            [
                (f"episode {row.episode:>6}", 0),
                (f"{row.level:<6}", 0),
                (f"return {row.normalised_return:7.3f}", 0),
                (f"arrived {row.arrived}/{row.trains}", 0),
                (f"steps {row.steps:>3}", 0),
                (f"epsilon {row.epsilon:.3f}" if row.epsilon else "", 2),  # policies have none
                (row.actor, 1),
                (f"staleness {row.staleness}" if row.staleness else "", 0),
            ],
            width,
        )
    return fitted(
        [
            (f"checkpoint {row.episode:>3}", 0),
            (f"{row.level:<6}", 0),
            (f"{row.mode} {row.normalised_return:7.3f}", 0),
            (f"arrived {row.arrived_share:.0%}", 0),
            (f"all arrived {row.all_arrived_share:.0%}", 0),
            (f"steps {row.mean_steps:.0f}", 1),
            ("" if row.score is None else f"score {row.score:.3f}", 0),
        ],
        width,
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
