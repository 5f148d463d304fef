"""The foreground of `railctl up`: a live view in a terminal, lines elsewhere; Ctrl-C and SIGTERM stop the run."""

import os
import signal
import time
from collections.abc import Callable, Iterable

from rich.live import Live
from rich.text import Text

from railctl.common.bus import Bus, NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.locks import holder
from railctl.common.records.rows import EvaluationRow
from railctl.deploy.follow import Row, Rows, live_status
from railctl.deploy.output import console, line_width
from railctl.deploy.runs import Failed, is_gone, reach, supervised
from railctl.deploy.show import progress_line, row_line, view
from railctl.deploy.termination import Terminated, terminable

REFRESH_S = 0.5
LINE_EVERY_S = 5.0
LOOK_S = 0.05


def follow_to_end(folder: RunFolder) -> bool:
    """Show a run until its supervisor ends. Ctrl-C or SIGTERM asks for a clean stop, a second one forces it.

    Returns:
        Whether SIGTERM came.

    Raises:
        Failed: the supervisor was killed, or the run's folder is gone, or nobody reads what is said here.
    """
    terminated = False
    with terminable():
        while supervised(folder):
            try:
                _follow(folder)
            except KeyboardInterrupt as interrupt:
                terminated = terminated or isinstance(interrupt, Terminated)
                _stop(folder)
            except BrokenPipeError:
                name = folder.path.name
                raise Failed(
                    f"nobody reads this any more; run {name} goes on: railctl tail {name} follows it"
                ) from None
    if is_gone(folder):
        raise Failed(f"{folder.path} is gone, and so its processes end")
    if not folder.outcome_file.exists():
        raise Failed(f"the supervisor was killed: railctl up --name {folder.path.name} takes over what lives")
    return terminated


def _follow(folder: RunFolder) -> None:
    follow = _in_terminal if console.is_terminal else _in_lines
    while supervised(folder):
        try:
            with reach(folder) as bus:
                follow(folder, bus)
        except NoAnswer:
            time.sleep(LOOK_S)  # the router is only starting, or is being started again


def _stop(folder: RunFolder) -> None:
    pid = holder(folder, "supervisor")
    if pid is not None:
        console.print("stopping cleanly; Ctrl-C again forces it")
        os.kill(pid, signal.SIGTERM)


def _in_terminal(folder: RunFolder, bus: Bus) -> None:
    evaluations: list[EvaluationRow] = []
    with Live(console=console, refresh_per_second=4, transient=True) as live:
        live.update(Text("starting ..."))
        rows = Rows(bus, folder)

        def show() -> None:
            live.update(view(live_status(bus), evaluations))

        _loop(folder, rows, evaluations.append, show, REFRESH_S)


def _in_lines(folder: RunFolder, bus: Bus) -> None:
    rows = Rows(bus, folder)
    _loop(
        folder,
        rows,
        lambda row: console.print(row_line(row, line_width()), markup=False, soft_wrap=True),
        lambda: console.print(progress_line(live_status(bus), line_width()), markup=False, soft_wrap=True),
        LINE_EVERY_S,
    )


def _loop(
    folder: RunFolder,
    rows: Rows,
    on_evaluation: Callable[[EvaluationRow], None],
    show: Callable[[], None],
    every_s: float,
) -> None:
    due = 0.0
    fresh: Iterable[Row] = rows.history()
    while True:
        for row in fresh:
            if isinstance(row, EvaluationRow):
                on_evaluation(row)
        if time.monotonic() >= due:
            due = time.monotonic() + every_s
            try:
                show()
            except NoAnswer:
                if not supervised(folder):
                    return
        if not supervised(folder):
            return
        fresh = rows.next(LOOK_S)
