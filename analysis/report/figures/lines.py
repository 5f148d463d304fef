"""Lines over episodes or thresholds, each with its band and its name at its end."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from railctl.analysis.report.figures.style import FAINT, Look, canvas, inches, lined, spread

Floats = NDArray[np.float64]
LABEL_GAP = 0.055  # of the height of a panel


@dataclass(frozen=True)
class Line:
    """Points x [P], y [P], and a band from low [P] to high [P], which may be nan."""

    x: Floats
    y: Floats
    low: Floats
    high: Floats


def panels(
    lines: Mapping[str, Mapping[str, Line]],
    styles: Mapping[str, Look],
    axes_of_all: Mapping[str, Any],
    *,
    ends_meet: bool = False,
) -> Figure:
    """A panel for each name, with a line for each contender; `axes_of_all` are labels and limits.

    Names stand at the ends of their lines, or in a corner if these `ends_meet`.
    """
    figure, [row] = canvas((4.1 + inches(styles)) * len(lines) + 0.6, 3.9, 1, len(lines), sharey=True)
    for number, (axes, (title, ours)) in enumerate(zip(row, lines.items(), strict=True)):
        axes.set(**(axes_of_all if number == 0 else {**axes_of_all, "ylabel": ""}))
        axes.set_title(title, loc="left", fontweight="bold")
        axes.grid(alpha=0.25, linewidth=0.6)
        for name, line in ours.items():
            _draw(axes, name, line, styles[name])
        if ends_meet:
            axes.legend(loc="lower left", fontsize=8, handlelength=4, frameon=False)
        else:
            _name_ends(axes, ours, styles)
    return figure


def _draw(axes: Axes, name: str, line: Line, look: Look) -> None:
    if np.isfinite(line.low).any():
        axes.fill_between(line.x, line.low, line.high, color=look.colour, alpha=0.13, linewidth=0)
    every = max(1, len(line.x) // 15)
    axes.plot(
        line.x,
        line.y,
        label=lined([name])[0],
        linestyle=look.dash,
        color=look.colour,
        linewidth=1.8,
        marker=look.marker,
        markersize=4.5,
        markevery=every,
        markeredgecolor="white",
        markeredgewidth=0.5,
    )


def _name_ends(axes: Axes, lines: Mapping[str, Line], styles: Mapping[str, Look]) -> None:
    """Names stand right of the panel, each tied to the end of its line."""
    low, high = axes.get_ylim()
    drawn = {name: line for name, line in lines.items() if len(line.x)}
    ends = [float(line.y[-1] - low) / (high - low) for line in drawn.values()]
    right = axes.get_xlim()[1]
    gap = LABEL_GAP * max(name.count("\n") + 1 for name in lined(drawn))
    for (name, line), place in zip(drawn.items(), spread(ends, gap, 0.0, 1.0), strict=True):
        look = styles[name]
        at = axes.get_yaxis_transform()  # x in shares of the panel, y in data
        height = low + place * (high - low)
        axes.plot([line.x[-1], right], [line.y[-1], line.y[-1]], color=FAINT, linewidth=0.4, alpha=0.6)
        axes.plot([1, 1.04], [line.y[-1], height], color=FAINT, linewidth=0.6, transform=at, clip_on=False)
        axes.plot([1.06], [height], look.marker, color=look.colour, markersize=5, transform=at, clip_on=False)
        axes.text(1.09, height, lined([name])[0], transform=at, va="center", fontsize=8, linespacing=1.0)
