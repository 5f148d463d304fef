"""Rankings as bars with their intervals, and above them a line for every pair that differs significantly."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from services.evaluator.report.figures.style import FAINT, INK, Look, canvas

Rule = Literal["both", "textbook", "tool"]
RULES: dict[Rule, tuple[str, str]] = {
    "both": ("-", "by both rules"),
    "textbook": ("--", "by Benjamini-Yekutieli at 0.05 alone"),
    "tool": (":", "by the tool's rule alone"),
}
STEP = 0.3  # between two lines, in ranks


@dataclass(frozen=True)
class Ranking:
    """A panel: bar heights [A], A being the best, their intervals [A][low, high], which may be nan, and pairs."""

    title: str
    heights: Sequence[float]
    intervals: Sequence[tuple[float, float]]
    pairs: Mapping[tuple[int, int], Rule]


def rankings(rows: Sequence[Sequence[Ranking]], styles: Mapping[str, Look]) -> Figure:
    """A grid of panels of the same contenders, the names of which are those of `styles`."""
    n_columns, n = len(rows[0]), len(styles)
    lanes = max((max(_lanes(panel.pairs).values(), default=-1) for row in rows for panel in row), default=-1) + 1
    top = n + 0.35 + STEP * (lanes + 1)
    width = max(3.4, 0.62 * n + 0.9)
    figure, axes = canvas(width * n_columns, (1.3 + 0.3 * top) * len(rows) + 0.4, len(rows), n_columns, sharey=True)
    for panels, places in zip(rows, axes, strict=True):
        for number, (panel, place) in enumerate(zip(panels, places, strict=True)):
            _draw(place, panel, styles)
            place.set(ylim=(0, top), ylabel=f"score (best: {n})" if number == 0 else "")
            place.set_yticks(range(n + 1))
    used = [rule for rule in RULES if any(rule in panel.pairs.values() for row in rows for panel in row)]
    if used:
        handles = [
            Line2D([], [], color=INK, linestyle=RULES[rule][0], label=f"differ {RULES[rule][1]}") for rule in used
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=8)
    return figure


def _draw(axes: Axes, panel: Ranking, styles: Mapping[str, Look]) -> None:
    for number, (height, (low, high), look) in enumerate(
        zip(panel.heights, panel.intervals, styles.values(), strict=True)
    ):
        axes.bar(number, height, 0.72, color=look.colour, hatch=look.hatch, edgecolor="white", linewidth=0)
        axes.bar(number, height, 0.72, fill=False, edgecolor=INK, linewidth=0.7)
        if np.isfinite(low):
            axes.errorbar(
                number,
                height,
                [[max(0.0, height - low)], [max(0.0, high - height)]],
                color=INK,
                capsize=3,
                linewidth=1.4,
            )
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        axes.text(number, 0.28, f"{height:.2f}", ha="center", va="center", fontsize=7, bbox=box)
    for (i, j), lane in _lanes(panel.pairs).items():
        y = len(styles) + 0.35 + STEP * (lane + 0.5)
        axes.plot([i, j], [y, y], color=INK, linewidth=1.1, linestyle=RULES[panel.pairs[i, j]][0])
        axes.plot([i, j], [y, y], "|", color=INK, markersize=4)
    axes.set_title(panel.title, loc="left", fontweight="bold")
    axes.set_xticks(
        range(len(styles)),
        list(styles),
        rotation=30 if max(map(len, styles)) > 5 else 0,
        ha="right" if max(map(len, styles)) > 5 else "center",
    )
    axes.tick_params(axis="x", length=0)
    axes.axhline(len(styles), color=FAINT, linewidth=0.5, linestyle=":")


def _lanes(pairs: Mapping[tuple[int, int], Rule]) -> dict[tuple[int, int], int]:
    """A lane for every pair, short ones lowest, so that no two in a lane touch."""
    lanes: list[list[tuple[int, int]]] = []
    found = {}
    for i, j in sorted(pairs, key=lambda pair: (pair[1] - pair[0], pair)):
        lane = next((k for k, taken in enumerate(lanes) if all(j < a or b < i for a, b in taken)), len(lanes))
        if lane == len(lanes):
            lanes.append([])
        lanes[lane].append((i, j))
        found[i, j] = lane
    return found
