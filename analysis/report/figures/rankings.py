"""Rankings as bars with their intervals, and above them a line for every pair that differs significantly."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from railctl.analysis.report.figures.style import INK, Look, below, canvas, inches, lined

Rule = Literal["both", "textbook", "tool"]
RULES: dict[Rule, tuple[str, str]] = {
    "both": ("-", "by both rules"),
    "textbook": ("--", "by Benjamini-Yekutieli at 0.05 alone"),
    "tool": (":", "by the tool's rule alone"),
}
LANES = 0.75  # from the number of contenders to the lowest line, in ranks
STEP = 0.3  # between two lines
BAR_INCHES = 0.62  # with the gap to the next


@dataclass(frozen=True)
class Ranking:
    """A panel: bar heights [A], the higher the better, their intervals [A][low, high], which may be nan, and pairs."""

    title: str
    heights: Sequence[float]
    intervals: Sequence[tuple[float, float]]
    pairs: Mapping[tuple[int, int], Rule]


def rankings(rows: Sequence[Sequence[Ranking]], styles: Mapping[str, Look]) -> Figure:
    """A grid of panels of the same contenders, the names of which are those of `styles`."""
    n_columns, n = len(rows[0]), len(styles)
    highest = max(lane for row in rows for panel in row for lane in (0, *lanes(panel.pairs).values()))
    top = n + LANES + STEP * (highest + 1)
    width, height = max(3.4, BAR_INCHES * n + 0.9), 1.2 + 0.3 * top + min(inches(styles), 2.0)
    figure, axes = canvas(width * n_columns, height * len(rows) + 0.3, len(rows), n_columns, sharey=True)
    for panels, places in zip(rows, axes, strict=True):
        for number, (panel, place) in enumerate(zip(panels, places, strict=True)):
            _draw(place, panel, styles)
            place.set(ylim=(0, top), ylabel="score (higher is better)" if number == 0 else "")
            place.set_yticks(range(n + 1))
    used = [rule for rule in RULES if any(rule in panel.pairs.values() for row in rows for panel in row)]
    if used:
        handles = [
            Line2D([], [], color=INK, linestyle=RULES[rule][0], label=f"differ {RULES[rule][1]}") for rule in used
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=8)
    return figure


def _draw(axes: Axes, panel: Ranking, styles: Mapping[str, Look]) -> None:
    for number, look in enumerate(styles.values()):
        height, interval = panel.heights[number], panel.intervals[number]
        axes.bar(number, height, 0.72, color=look.colour, hatch=look.hatch, edgecolor="white", linewidth=0)
        axes.bar(number, height, 0.72, fill=False, edgecolor=INK, linewidth=0.7)
        axes.plot([number, number], interval, "_-", color=INK, markersize=7, linewidth=1.4)
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        axes.text(number, 0.28, f"{height:.2f}", ha="center", va="center", fontsize=7, bbox=box)
    for pair, lane in lanes(panel.pairs).items():
        y = len(styles) + LANES + STEP * lane
        axes.plot(pair, [y, y], color=INK, linewidth=1.1, linestyle=RULES[panel.pairs[pair]][0])
        axes.plot(pair, [y, y], "|", color=INK, markersize=4)
    axes.set_title(panel.title, loc="left", fontweight="bold")
    axes.set_xticks(range(len(styles)), lined(styles), **below(styles, BAR_INCHES))
    axes.tick_params(axis="x", length=0)


def lanes(pairs: Mapping[tuple[int, int], Rule]) -> dict[tuple[int, int], int]:
    """A lane for every pair, short ones lowest, so that no two in a lane touch."""
    taken: list[list[tuple[int, int]]] = []
    found = {}
    for i, j in sorted(pairs, key=lambda pair: (pair[1] - pair[0], pair)):
        lane = next(
            (k for k, pairs_there in enumerate(taken) if all(j < a or b < i for a, b in pairs_there)), len(taken)
        )
        if lane == len(taken):
            taken.append([])
        taken[lane].append((i, j))
        found[i, j] = lane
    return found
