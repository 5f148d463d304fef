"""Figures with their intervals, side by side, and matrices of shares."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from railctl.analysis.report.figures.style import INK, Look, below, canvas, inches, lined
from railctl.analysis.report.tables import Interval

CELL_INCHES = 0.95, 0.55  # of a matrix


def dots(columns: Mapping[str, Mapping[str, Interval]], styles: Mapping[str, Look]) -> Figure:
    """A panel for each title, with a row for each contender: a dot and its interval."""
    names, row_inches = list(styles), 0.38 * max(1, *(name.count(" ") for name in styles))
    figure, [row] = canvas(
        4.2 * len(columns) + inches(styles), 0.9 + row_inches * len(styles), 1, len(columns), sharey=True
    )
    for axes, (title, estimates) in zip(row, columns.items(), strict=True):
        for name, (value, low, high) in estimates.items():
            look, place = styles[name], names.index(name)
            if np.isfinite(low):
                axes.plot(
                    [low, high], [place, place], color=look.colour, linewidth=5, alpha=0.35, solid_capstyle="butt"
                )
                axes.plot([low, high], [place, place], "|", color=INK, markersize=8)
            axes.plot(value, place, look.marker, color=look.colour, markeredgecolor=INK, markersize=7)
            axes.text(value, place - 0.26, f"{value:.3f}", ha="center", va="bottom", fontsize=7.5)
        axes.set_title(title, loc="left", fontweight="bold")
        axes.set_yticks(range(len(names)), lined(names))
        axes.set_ylim(len(names) - 0.5, -0.7)
        axes.margins(x=0.12)
        axes.grid(axis="x", alpha=0.25, linewidth=0.6)
        axes.tick_params(axis="y", length=0)
    return figure


def matrix(
    values: NDArray[np.float64],
    rows: Sequence[str],
    columns: Sequence[str],
    texts: Sequence[Sequence[str]],
    across: str,
) -> Figure:
    """Shares [rows, columns] in [0, 1], the darker the higher, each written out; nan stays empty."""
    width, height = CELL_INCHES
    size = 1.1 + inches(rows) + width * len(columns), 0.7 + min(inches(columns), 2.0) + height * len(rows)
    figure, [[axes]] = canvas(*size)
    axes.imshow(np.where(np.isnan(values), 0, values), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, line in enumerate(texts):
        for j, text in enumerate(line):
            colour = "white" if values[i, j] > 0.6 else "black"
            axes.text(j, i, text, ha="center", va="center", fontsize=7.5, color=colour)
    axes.set_xticks(range(len(columns)), lined(columns), **below(columns, width))
    axes.set_yticks(range(len(rows)), lined(rows))
    axes.set_xlabel(across)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return figure
