"""What all benchmarks share: both sides do the same work in turn, in one process, and must agree on what comes out.

A benchmark is a module with a function that gives its `Comparison`s, and a `main` that hands it to `run`. It prints one
document `{"rows": [{"name", "unit", "ours", "theirs", "ratio", "repeats"}]}`: medians over the repeats, less is better
unless the unit is a rate, `.../s`, and a ratio above 1 says that ours is better.
"""

import argparse
import gc
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from io import StringIO
from statistics import median
from typing import Any, NamedTuple, NoReturn, Self, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from railctl.common.strict import nearest, shortened
from railctl.common.task import FAILED, WRONG_USAGE

REPEATS = 5
Result = TypeVar("Result")
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Row:
    """One comparison; a ratio above 1 says that ours is better."""

    name: str
    unit: str
    ours: float
    theirs: float
    ratio: float
    repeats: int


class Sample(NamedTuple):
    """What both needed in one repeat, in `unit`, of which less is better; or a rate, of which more is."""

    name: str
    unit: str
    ours: float
    theirs: float

    @property
    def is_rate(self) -> bool:
        return self.unit.endswith("/s")


@dataclass(frozen=True)
class Comparison:
    """Work for both sides.

    Attributes:
        name: what is said while it goes on.
        once: does it, given the number of the repeat (0 only warms up); every repeat gives samples of the same names.
    """

    name: str
    once: Callable[[int], Sequence[Sample]]


class DisagreementError(RuntimeError):
    """The two sides did not do the same: the times mean nothing."""


def measure(comparisons: Sequence[Comparison], repeats: int, tell: Tell = lambda *_: None) -> list[Row]:
    """The rows of all comparisons; `tell` is called with a name, and how many of how many repeats are done.

    Raises:
        DisagreementError: from a comparison.
    """
    rows, total = [], len(comparisons) * (repeats + 1)
    for number, comparison in enumerate(comparisons):
        found: dict[tuple[str, str], list[Sample]] = {}
        for repeat in range(repeats + 1):
            tell(comparison.name, number * (repeats + 1) + repeat, total)
            for sample in comparison.once(repeat):
                found.setdefault((sample.name, sample.unit), []).append(sample)
        rows += [row_of(samples[1:]) for samples in found.values()]
    tell("done", total, total)
    return rows


def row_of(samples: Sequence[Sample]) -> Row:
    """The medians of repeats, to four digits."""
    ours, theirs = median(sample.ours for sample in samples), median(sample.theirs for sample in samples)
    ratio = ours / theirs if samples[0].is_rate else theirs / ours
    rounded = [float(f"{number:.4g}") for number in (ours, theirs, ratio)]
    return Row(samples[0].name, samples[0].unit, rounded[0], rounded[1], rounded[2], len(samples))


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Processor seconds of `work`, and what it returns; the garbage of earlier work is not on its bill."""
    gc.collect()
    begun = time.process_time()
    result = work()
    return time.process_time() - begun, result


def run(description: str, comparisons: Callable[..., Sequence[Comparison]], **options: int | tuple[str, ...]) -> None:
    """Be a benchmark's command line: measure on one core, with progress on stderr, and print the rows.

    Args:
        description: for the help.
        comparisons: gives the work, by the `options`.
        options: their defaults if they count something, else what may be chosen, the default first.
    """
    given = _parse(description, options)
    as_json, repeats = given.pop("json"), given.pop("repeats")
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    gc.freeze()  # nobody pays for looking through all that was imported
    try:
        # what libraries say there belongs to nobody
        with warnings.catch_warnings(action="ignore"), redirect_stdout(StringIO()), _Shower() as shower:
            rows = measure(comparisons(**given), repeats, shower.show)
    except DisagreementError as error:
        print(f"railctl: the two sides differ, so no times are given: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(FAILED)
    show(rows, as_json=as_json)


def show(rows: Sequence[Row], *, as_json: bool) -> None:
    """Print the rows for a program or for a person."""
    if as_json:
        print(json.dumps({"rows": [asdict(row) for row in rows]}, indent=2))  # noqa: T201
        return
    repeats = max(row.repeats for row in rows)
    table = Table("", "unit", box=None, pad_edge=False, caption=f"medians of {repeats} repeats", caption_justify="left")
    for side in ("ours", "theirs", "ratio"):
        table.add_column(side, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row.name, row.unit, f"{row.ours:g}", f"{row.theirs:g}", f"{row.ratio:g}x")
    Console(highlight=False).print(table)


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG_USAGE, f"railctl: {message.removeprefix('argument ')}\n")


def _parse(description: str, options: Mapping[str, int | tuple[str, ...]]) -> dict[str, Any]:
    parser = Parser(description=description, allow_abbrev=False)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    for option, values in {"repeats": REPEATS, **options}.items():
        if isinstance(values, tuple):
            parser.add_argument(f"--{option}", type=one_of(values), default=values[0], help="default: %(default)s")
        else:
            parser.add_argument(f"--{option}", type=count, default=values, help="default: %(default)s")
    return vars(parser.parse_args())


def count(text: str) -> int:
    """The value of an option that counts something."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return int(text)


def one_of(known: Sequence[str]) -> Callable[[str], str]:
    """What reads an option that is a choice."""

    def chosen(text: str) -> str:
        if text not in known:
            raise argparse.ArgumentTypeError(f"unknown {shortened(text)}{nearest(text, list(known))}")
        return text

    return chosen


class _Shower:
    """A bar on a terminal, a line a comparison elsewhere; on stderr."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=self._console, transient=True, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("preparing", total=None)
        self._last = ""

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._bar.stop()

    def show(self, name: str, done: int, total: int) -> None:
        self._bar.update(self._task, description=name, completed=done, total=total)
        if not self._console.is_terminal and name != self._last:
            self._console.print(f"{done} of {total} repeats: {name}", markup=False, soft_wrap=True)
        self._last = name
