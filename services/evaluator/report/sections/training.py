"""Figure 5.2: returns while training."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.config import Difficulty
from services.evaluator.report.figures.lines import Line, panels
from services.evaluator.report.figures.style import Look
from services.evaluator.report.parts import Figure, Section
from services.evaluator.report.results import Results

OPTIMAL = -0.1  # what the study takes for the score of optimal agents


def training(results: Results, styles: Mapping[str, Look]) -> Section:
    """Curves of all runs, also of those that are not whole."""
    runs = {level: {name: _curves(results, name, level) for name in results.contenders} for level in results.levels}
    known = {
        level: {name: curves for name, curves in of_level.items() if any(len(curve) for curve in curves)}
        for level, of_level in runs.items()
    }
    if not any(known.values()):
        text = f"No run has trained a whole evaluation point of {results.judgement.block} episodes yet: there is nothing to draw."
        return Section("Training curves", (text,))
    block = results.judgement.block
    points = {
        level: {name: _summary(curves) for name, curves in of_level.items()} for level, of_level in known.items() if of_level
    }
    lines = {
        level: {
            name: Line(block * np.arange(1, len(found) + 1), found[:, 1], found[:, 2], found[:, 3])
            for name, found in of_level.items()
        }
        for level, of_level in points.items()
    }
    axes = {"xlabel": "episode", "ylabel": "normalised return", "ylim": (-1.02, 0.02), "xlim": (0, results.episodes)}
    numbers = {
        level: {
            name: dict(zip(("runs", "median", "low", "high"), found.T.tolist(), strict=True)) | {"episode": line[name].x.tolist()}
            for name, found in points[level].items()
        }
        for level, line in lines.items()
    }
    caption = (
        f"Median over runs of the mean return of {block} training episodes, and between the 2.5th and the 97.5th percentile "
        f"of the runs, shaded ({_counts(known)}). Exploration is part of it, so a network that acts greedily does better. "
        "Up is better; what is not drawn has not been trained."
    )
    figure = Figure("figure-5.2", "Figure 5.2: training curves", caption, panels(lines, styles, axes), numbers)
    return Section("Training curves", (figure,))


def _curves(results: Results, name: str, level: Difficulty) -> list[NDArray[np.float64]]:
    return [results.block_means(trained) for trained in results.cell(name, level)]


def _summary(curves: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Of curves [P] of different length: runs, median and interval of those that got to a point [P, 4]."""
    rows = []
    for point in range(max(map(len, curves))):
        there = [curve[point] for curve in curves if len(curve) > point]
        low, high = np.percentile(there, [2.5, 97.5]) if len(there) > 1 else (np.nan, np.nan)
        rows.append([len(there), np.median(there), low, high])
    return np.array(rows, dtype=np.float64)


def _counts(known: Mapping[Difficulty, Mapping[str, list[NDArray[np.float64]]]]) -> str:
    counts = {sum(len(curve) > 0 for curve in curves) for of_level in known.values() for curves in of_level.values()}
    least, most = min(counts), max(counts)
    return f"n = {most} runs each" if least == most else f"n = {least} to {most} runs"
