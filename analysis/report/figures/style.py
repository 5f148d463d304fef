"""How contenders look everywhere: a colour, and a dash, a marker and a hatch for whoever sees no colour."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")  # Okabe & Ito
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)), (0, (8, 2)), (0, (3, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
HATCHES = ("", "//", "..", "\\\\", "xx", "--", "oo", "++")
LETTER_INCHES = 0.075
PLACES, LONG = re.compile(rb' (?:d|x|y)="[^"]*"'), re.compile(rb"-?[0-9]+\.[0-9]{3,}")
INK, FAINT = "#222222", "#888888"

SETTINGS = {
    "svg.hashsalt": "railctl",  # equal numbers, equal bytes
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": FAINT,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "hatch.linewidth": 0.6,
}


@dataclass(frozen=True)
class Look:
    """One contender's."""

    colour: str
    dash: Any
    marker: str
    hatch: str


def looks(names: Sequence[str]) -> dict[str, Look]:
    """A look for each name; neighbours differ in all four, and no two of 42 are the same."""
    return {
        name: Look(
            COLOURS[number % len(COLOURS)],
            DASHES[number % len(DASHES)],
            MARKERS[number % len(MARKERS)],
            HATCHES[number % len(HATCHES)],
        )
        for number, name in enumerate(names)
    }


def lined(names: Iterable[str]) -> list[str]:
    """Names as they stand in a figure: settings that they hold below each other."""
    return [name.replace(" ", "\n") for name in names]


def inches(names: Iterable[str]) -> float:
    """How wide the widest of these is as `lined`."""
    return LETTER_INCHES * max(len(line) for name in lined(names) for line in name.split("\n"))


def below(names: Iterable[str], width: float) -> dict[str, Any]:
    """How names stand below places that are so many inches wide: upright ones lie down as they grow longer."""
    needed = inches(names)
    if needed <= width:
        return {"rotation": 0, "ha": "center"}
    return {"rotation": 30, "ha": "right"} if needed <= 2 * width else {"rotation": 90, "ha": "center"}


def canvas(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, list[list[Axes]]]:
    """A figure of so many inches, and its panels by row and column."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options).tolist()


def spread(heights: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Places for labels, as near to their heights as they can be without lying on each other.

    >>> spread([0.5, 0.0, 0.5], gap=0.25, low=0.0, high=1.0)
    [0.5, 0.0, 0.75]
    """
    order = sorted(range(len(heights)), key=lambda number: heights[number])
    places = [0.0] * len(heights)
    below = low - gap
    for number in order:
        places[number] = below = max(heights[number], below + gap)
    above = high + gap
    for number in reversed(order):
        places[number] = above = min(places[number], above - gap)
    return places


def image(figure: Figure, kind: str) -> bytes:
    """The figure as `svg` or `png`, without dates or names of programs: equal figures have equal bytes."""
    nothing = {"svg": ("Date", "Creator", "Format", "Type"), "png": ("Software",)}[kind]
    file = BytesIO()
    figure.savefig(file, format=kind, dpi=150, metadata=dict.fromkeys(nothing))
    return rounded(file.getvalue()) if kind == "svg" else file.getvalue()


def rounded(svg: bytes) -> bytes:
    """Places to a hundredth of a point, which nobody sees; matplotlib's millionths take half of a file.

    >>> rounded(b'<path d="M 1.234567 -8.765432" transform="scale(0.015625)"/>')
    b'<path d="M 1.23 -8.77" transform="scale(0.015625)"/>'
    """
    return PLACES.sub(lambda found: LONG.sub(lambda number: b"%.2f" % float(number[0]), found[0]), svg)
