"""A level as a picture: rails as flatland's transition maps say, trains where they start, and where they go.

Where the rails lie: `common.rail.tracks`.
"""

from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects
from matplotlib import pyplot as plt
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from numpy.typing import NDArray

from railctl.common.levels.level import Level
from railctl.common.rail.decisions import STEPS
from railctl.common.rail.tracks import BED, COLOURS, GRID_LINE, GROUND, STEEL, arrowhead, tracks, way
from railctl.tools.levels.routes import Place, shortest_route

HEADINGS = "NESW"
CELL_INCHES, MOST_INCHES = 0.34, 24.0  # of a cell, and of all
LINES_PER_INCH, LEAST_LINES = 5.0, 12  # of the legend, beside the map
HALO = [patheffects.withStroke(linewidth=2.2, foreground="white")]


def draw(level: Level, path: Path, title: str) -> Path:
    """Draw a level into a .png file; returns its path."""
    mpl.use("Agg")
    height, width = level.grid.shape
    inches = min(CELL_INCHES, MOST_INCHES / max(height, width))
    figure = plt.figure(figsize=(width * inches, height * inches))  # the map; saving makes room for what is around it
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(height, 0), aspect="equal", facecolor=GROUND)
    axes.set_title(title, fontsize=11, loc="left")
    _ticks(axes, height, width)
    _rails(axes, level.grid, inches / CELL_INCHES)
    handles = [_train(axes, level, train) for train in range(level.n_trains)]
    axes.legend(
        handles=handles,
        title=f"{level.n_trains} train{'s' * (level.n_trains != 1)}, {level.max_steps} steps\ntrain: start to target",
        loc="upper left",
        bbox_to_anchor=(1.01, 1),
        ncols=ceil(level.n_trains / max(LEAST_LINES, int(height * inches * LINES_PER_INCH) - 3)),
        frameon=False,
        alignment="left",
        fontsize=9,
    )
    figure.savefig(path, dpi=130, bbox_inches="tight")
    plt.close(figure)
    return path


def _ticks(axes: Any, height: int, width: int) -> None:
    """Numbers in the middle of cells, lines between them."""
    every = 5 if max(height, width) > 12 else 1
    axes.set_xticks(np.arange(0, width, every) + 0.5, [str(column) for column in range(0, width, every)])
    axes.set_yticks(np.arange(0, height, every) + 0.5, [str(row) for row in range(0, height, every)])
    axes.set_xticks(np.arange(width + 1), minor=True)
    axes.set_yticks(np.arange(height + 1), minor=True)
    axes.grid(which="minor", color=GRID_LINE, linewidth=0.6)
    axes.tick_params(which="both", length=0, labelsize=8, labeltop=True, labelbottom=False)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_color(GRID_LINE)


def _rails(axes: Any, grid: NDArray[np.uint16], scale: float) -> None:
    lines, stops = tracks(grid)
    for parts, colour, thickness, order in ((lines, BED, 6.0, 2), (lines, STEEL, 1.5, 2.1), (stops, STEEL, 3.0, 3)):
        axes.add_collection(
            LineCollection(list(parts), colors=colour, linewidths=thickness * scale, capstyle="butt", zorder=order)
        )


def _train(axes: Any, level: Level, train: int) -> Line2D:
    """Draw a train's shortest way, start and target; returns its line of the legend."""
    colour = COLOURS[train % len(COLOURS)]
    row, column, heading = level.starts[train].tolist()
    target_row, target_column = level.targets[train].tolist()
    route = shortest_route(level, train)
    if route is not None:
        shift = 0.44 * ((train + 0.5) / level.n_trains - 0.5)  # beside each other where they share rails
        axes.plot(*(_track(route) + shift).T, color=colour, linewidth=1.6, alpha=0.6, zorder=4)
    _arrow(axes, level, train, colour)
    _goal(axes, level, train, colour)
    _number(axes, (row - 0.62, column), train, colour, level.starts[:, :2].tolist())
    _number(axes, (target_row + 0.64, target_column), train, colour, level.targets.tolist())
    distance = "no way" if route is None else f"{len(route) - 1} cells"
    text = f"{train}: ({row}, {column}) {HEADINGS[heading]} to ({target_row}, {target_column}), {distance}"
    return Line2D([], [], color=colour, marker="s", linestyle="-", markersize=7, label=text)


def _track(route: list[Place]) -> NDArray[np.float64]:
    """[P, 2]: the rails of a route, from the middle of its first cell to the middle of its last."""
    (row, column, _), (last_row, last_column, _) = route[0], route[-1]
    parts = [np.array([[column + 0.5, row + 0.5]])]
    for (row, column, heading), (_, _, towards) in pairwise(route):
        leg = way(row, column, heading, towards)
        parts.append(leg[-1:] if len(parts) == 1 else leg)
    parts.append(np.array([[last_column + 0.5, last_row + 0.5]]))
    return np.concatenate(parts)


def _place_among(cells: list[list[int]], train: int) -> tuple[int, int]:
    """Which of how many trains it is on its cell."""
    same = [other for other, cell in enumerate(cells) if cell == cells[train]]
    return same.index(train), len(same)


def _arrow(axes: Any, level: Level, train: int, colour: str) -> None:
    """An arrowhead with the train's heading; trains that stand alike share one, in the colour of the first."""
    starts = level.starts.tolist()
    if starts[train] in starts[:train]:
        return
    row, column, heading = starts[train]
    alone = all(start[:2] != [row, column] or start[2] == heading for start in starts)
    size, ahead = (0.46, 0.0) if alone else (0.3, 0.26)
    forwards = np.array([STEPS[heading][1], STEPS[heading][0]])
    middle = np.array([column + 0.5, row + 0.5]) + ahead * forwards
    axes.add_patch(
        Polygon(arrowhead(middle, heading, size), facecolor=colour, edgecolor="white", linewidth=1.0, zorder=6)
    )


def _goal(axes: Any, level: Level, train: int, colour: str) -> None:
    """A square frame; those of several trains lie inside each other."""
    row, column = level.targets[train].tolist()
    at, of = _place_among(level.targets.tolist(), train)
    inset = 0.04 + at * min(0.12, 0.4 / of)
    side = 1 - 2 * inset
    corner = (column + inset, row + inset)
    axes.add_patch(Rectangle(corner, side, side, facecolor="none", edgecolor=colour, linewidth=2.0, zorder=5))


def _number(axes: Any, where: tuple[float, float], train: int, colour: str, cells: list[list[int]]) -> None:
    """A train's number at (row, column), beside those of trains on the same cell."""
    at, of = _place_among(cells, train)
    axes.text(
        where[1] + 0.5 + 0.45 * (at - (of - 1) / 2),
        where[0] + 0.5,
        str(train),
        color=colour,
        fontsize=8,
        fontweight="bold",
        ha="center",
        va="center",
        zorder=8,
        path_effects=HALO,
    )
