"""What a report is made of: sections of text, figures and tables."""

from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure as Drawing

from railctl.analysis.report.tables import Table


@dataclass(frozen=True)
class Figure:
    """A figure of a report: `name` is that of its files, `numbers` are what it shows."""

    name: str
    title: str
    caption: str
    drawing: Drawing
    numbers: Any


@dataclass(frozen=True)
class Listing:
    """Lines that belong together."""

    lines: tuple[str, ...]


Part = str | Listing | Figure | Table  # a str is a paragraph


@dataclass(frozen=True)
class Section:
    """A part of the page with a heading."""

    title: str
    parts: tuple[Part, ...]
