"""Figure 5.2: returns while training."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from railctl.analysis.report.figures.lines import Line, panels
from railctl.analysis.report.figures.style import Look
from railctl.analysis.report.parts import Figure, Section
from railctl.analysis.report.results import Results

TITLE = "Training curves"
COLUMNS = ("runs", "median", "low", "high")
OPTIMAL = -0.1  # what the study takes for the score of optimal agents


def training(results: Results, styles: Mapping[str, Look]) -> Section:
    """Curves of all runs, also of those that are not whole."""
    points = {
        level: {name: found for name in results.contenders if len(found := _points(results, name, level))}
        for level in results.levels
    }
    if not any(points.values()):
        text = f"No run has trained a whole evaluation point of {results.judgement.block} episodes yet."
        return Section(TITLE, (text,))
    lines = {str(level): {name: _line(results, found) for name, found in of.items()} for level, of in points.items()}
    axes = {"xlabel": "episode", "ylabel": "normalised return", "ylim": (-1.02, 0.02), "xlim": (0, results.episodes)}
    counts = [int(found[0, 0]) for of in points.values() for found in of.values()]
    n = f"n = {max(counts)} runs each" if len(set(counts)) == 1 else f"n = {min(counts)} to {max(counts)} runs"
    caption = (
        f"Median over runs of the mean return of {results.judgement.block} training episodes, and, shaded, from the "
        f"2.5th to the 97.5th percentile of the runs ({n}). Value methods explore while they train, so the first half "
        "of their curves shows less than they know. Up is better; what is not drawn has not been trained."
    )
    numbers = {
        level: {name: dict(zip(COLUMNS, found.T.tolist(), strict=True)) for name, found in of.items()}
        for level, of in points.items()
    }
    figure = Figure("figure-5.2", "Figure 5.2: training curves", caption, panels(lines, styles, axes), numbers)
    return Section(TITLE, (figure,))


def _points(results: Results, name: str, level: str) -> NDArray[np.float64]:
    """Of every evaluation point, over the runs that got there, their number, median and interval [P, 4]."""
    curves = [results.block_means(trained) for trained in results.cell(name, level)]
    rows = []
    for point in range(max(map(len, curves), default=0)):
        there = [curve[point] for curve in curves if len(curve) > point]
        low, high = np.percentile(there, [2.5, 97.5]) if len(there) > 1 else (np.nan, np.nan)
        rows.append([len(there), np.median(there), low, high])
    return np.array(rows, dtype=np.float64)


def _line(results: Results, points: NDArray[np.float64]) -> Line:
    return Line(results.judgement.block * np.arange(1.0, len(points) + 1), *points[:, 1:].T)
