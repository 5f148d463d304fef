"""Work on levels, carried out by `common.levels.tasks` in a process of its own: this one need not import flatland."""

import json
import os
import subprocess
import sys
import tempfile
import time
from typing import Any, Self

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from deploy.output import console
from deploy.plan import ENVIRONMENT
from deploy.runs import Failed

LINE_EVERY_S = 5.0  # where there is no terminal to draw a bar on


def run_task(task: str, *arguments: str, quiet: bool) -> dict[str, Any]:
    """Run a task to its end, with progress and time left on the terminal unless `quiet`; returns its result.

    Raises:
        Failed: it failed; the text is its own.
    """
    command = [sys.executable, "-m", "common.levels.tasks", task, *arguments]
    with (
        tempfile.TemporaryFile("w+") as complaints,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=complaints, text=True, env=os.environ | ENVIRONMENT
        ) as process,
    ):
        assert process.stdout is not None  # noqa: S101  (a pipe was asked for)
        result = {}
        try:
            with _Shower(quiet) as shower:
                for line in process.stdout:
                    document = json.loads(line)
                    if "progress" in document:
                        shower.show(**document["progress"])
                    else:
                        result = document
        except BaseException:
            process.terminate()
            raise
        if process.wait():
            complaints.seek(0)
            raise Failed((complaints.read().splitlines() or [f"levels {task} was killed: run it again"])[-1])
    return result


class _Shower:
    """A bar on a terminal, a line now and then elsewhere."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._next_line = 0.0
        self._bar = Bar(
            TextColumn("{task.description:8}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
            disable=quiet or not console.is_terminal,
        )
        self._task = self._bar.add_task("", total=None, left="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._bar.stop()

    def show(self, of: str, done: int, total: int, seconds_left: float | None) -> None:
        left = time_left(seconds_left) if done < total else ""
        self._bar.update(self._task, description=of, completed=done, total=total, left=left)
        if not self._quiet and not console.is_terminal and (time.monotonic() > self._next_line or done == total):
            console.print(f"{of}: {done} of {total} {left}".rstrip(), markup=False)
            self._next_line = time.monotonic() + LINE_EVERY_S


def time_left(seconds: float | None) -> str:
    """As people say it.

    >>> time_left(75.2), time_left(8), time_left(None)
    ('1 min 15 s left', '8 s left', '')
    """
    if seconds is None:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s left" if minutes else f"{rest} s left"
