"""Tables: cells that are shown in one way and kept, in full, in another."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any, NamedTuple

NOTHING = "-"


class Spread(NamedTuple):
    """A mean and the standard deviation of what it is the mean of, if there is more than one."""

    mean: float
    std: float | None


class Interval(NamedTuple):
    """A figure and its 95% interval."""

    value: float
    low: float
    high: float


class Beside(NamedTuple):
    """Ours, and what the study has in its place, if it has."""

    ours: str | None
    study: str | None


Plain = str | int | float | None
Cell = Plain | Spread | Interval | Beside


class Column(NamedTuple):
    """A heading, and how numbers below it are shown."""

    heading: str
    spec: str = ".3f"
    of_std: str | None = None  # none: as all else


@dataclass(frozen=True)
class Table:
    """A table of a report: `name` is that of its file."""

    name: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: Sequence[Sequence[Cell]]
    is_folded: bool = False  # long, and of interest to few

    def shown(self) -> list[list[str]]:
        """All cells as they are read on the page."""
        return [
            [shown(cell, column.spec, column.of_std) for cell, column in zip(row, self.columns, strict=True)]
            for row in self.rows
        ]

    def records(self) -> list[dict[str, Plain]]:
        """All rows in full precision, a name for each number."""
        found: list[dict[str, Plain]] = []
        for row in self.rows:
            record: dict[str, Plain] = {}
            for cell, column in zip(row, self.columns, strict=True):
                record |= plain(column.heading, cell)
            found.append(record)
        return found

    def csv(self) -> str:
        """The records as text."""
        records = self.records()
        headings = list(dict.fromkeys(heading for record in records for heading in record))
        text = StringIO()
        writer = csv.DictWriter(text, headings or [column.heading for column in self.columns], lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
        return text.getvalue()


def shown(cell: Cell, spec: str, of_std: str | None = None) -> str:
    """A cell as it is read.

    >>> shown(Spread(-0.25, 0.0625), ".3f"), shown(Interval(0.5, 0.25, 0.75), ".2f"), shown(Beside("64", "128"), "")
    ('-0.250 ± 0.062', '0.50 [0.25, 0.75]', '64 (128)')
    """
    match cell:
        case None:
            return NOTHING
        case float():
            return format(cell, spec) if math.isfinite(cell) else NOTHING
        case Spread(mean, std):
            return shown(mean, spec) if std is None else f"{mean:{spec}} ± {std:{of_std or spec}}"
        case Interval(value, low, high):
            return f"{value:{spec}} [{low:{spec}}, {high:{spec}}]" if math.isfinite(low) else shown(value, spec)
        case Beside(ours, study):
            return shown(ours, spec) if study in (None, ours) else f"{shown(ours, spec)} ({study})"
        case _:
            return str(cell)


def plain(heading: str, cell: Cell) -> dict[str, Plain]:
    """A cell as numbers and text of their own."""
    match cell:
        case Spread(mean, std):
            found: dict[str, Any] = {heading: mean, f"{heading} std": std}
        case Interval(value, low, high):
            found = {heading: value, f"{heading} low": low, f"{heading} high": high}
        case Beside(ours, study):
            found = {heading: ours, f"{heading} of the study": study}
        case _:
            found = {heading: cell}
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in found.items()
    }
