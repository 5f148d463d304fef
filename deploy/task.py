"""Work that a process of its own carries out (see `common.task`), as it needs what this one must not import."""

import json
import os
import subprocess
import tempfile
import time
from typing import IO, Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from railctl.common.interpreter import run_worker
from railctl.common.strict import ConfigError
from railctl.common.task import WRONG_USAGE
from railctl.deploy.plan import ENVIRONMENT
from railctl.deploy.runs import Failed

END_PATIENCE_S = 2.0
LINE_EVERY_S = 5.0  # where there is no terminal to draw a bar on


def run_task(module: str, *arguments: str, shows: bool = True) -> dict[str, Any]:
    """Run a module to its end, with progress and time left on stderr if it `shows` them; returns its result.

    Raises:
        ConfigError: it was asked for what cannot be; the text is its own.
        Failed: it failed; likewise.
    """
    command = run_worker(module, *arguments)
    with (
        tempfile.TemporaryFile("w+") as complaints,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=complaints, text=True, env=os.environ | ENVIRONMENT
        ) as process,
    ):
        assert process.stdout is not None  # noqa: S101  (a pipe was asked for)
        result = {}
        try:
            with _Shower(shows=shows) as shower:
                for line in process.stdout:
                    document = json.loads(line)
                    if "progress" in document:
                        shower.show(**document["progress"])
                    else:
                        result = document
        except BaseException:
            end(process, END_PATIENCE_S)
            raise
        _check_end(module, process.wait(), complaints)
    return result


class Task:
    """A task beside others, whose progress nobody listens to. It has a session of its own: Ctrl-C does not reach it."""

    def __init__(self, module: str, *arguments: str) -> None:
        self._module = module
        self._said = tempfile.TemporaryFile("w+")  # noqa: SIM115  (it is read when the process has ended)
        self._complaints = tempfile.TemporaryFile("w+")  # noqa: SIM115
        self._process = subprocess.Popen(
            run_worker(module, *arguments),
            stdin=subprocess.DEVNULL,
            stdout=self._said,
            stderr=self._complaints,
            env=os.environ | ENVIRONMENT,
            start_new_session=True,
        )

    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def wait(self) -> None:
        """Return when it has ended."""
        self._process.wait()

    def result(self) -> dict[str, Any]:
        """The result of a task that has ended; raises as `run_task` does."""
        with self._said, self._complaints:
            _check_end(self._module, self._process.wait(), self._complaints)
            self._said.seek(0)
            result: dict[str, Any] = json.loads((self._said.read().splitlines() or ["{}"])[-1])
            return result

    def end(self) -> None:
        """Have it end; it leaves nothing behind."""
        self._process.kill()


def end(process: subprocess.Popen[Any], patience_s: float) -> None:
    """Have a process leave nothing half done, unless that takes too long: compiled code hears of no signal."""
    process.terminate()
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        process.kill()


def _check_end(module: str, code: int, complaints: IO[str]) -> None:
    if code:
        complaints.seek(0)
        text = (complaints.read().splitlines() or [f"{module} was killed: run it again"])[-1]
        raise ConfigError(text) if code == WRONG_USAGE else Failed(text)


class _Shower:
    """A bar on a terminal, a line now and then elsewhere; on stderr, where it disturbs no result."""

    def __init__(self, *, shows: bool = True) -> None:
        self._console = Console(stderr=True, highlight=False, quiet=not shows)
        self._next_line = 0.0
        self._bar = Bar(
            TextColumn("{task.description:8}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task("", total=None, left="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._bar.stop()

    def show(self, of: str, done: int, total: int | None, seconds_left: float | None) -> None:
        left = time_left(seconds_left) if done != total else ""
        if total is None:
            self._bar.reset(self._task, total=None)  # a total that was known before would stay
        self._bar.update(self._task, description=of, completed=done, total=total, left=left)
        if not self._console.is_terminal and (time.monotonic() > self._next_line or done == total):
            count = f"function {done}" if total is None else f"{done} of {total}"
            self._console.print(f"{of}: {count} {left}".rstrip(), markup=False)
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
