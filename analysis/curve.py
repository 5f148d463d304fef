"""python -m railctl.analysis.curve --run FOLDER: draws the learning curve of a run as `curve.png` in its folder.

It draws when its input ends, so that it can be started before there is everything to draw.
"""

import argparse
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from numpy.typing import NDArray

from railctl.common.folder import RunFolder
from railctl.common.process import run_service
from railctl.common.records.rows import EpisodeRow, EvaluationRow
from railctl.common.rows import read_rows

WINDOW = 100
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9")  # Okabe & Ito: told apart by everybody
DASHES = ("-", "--", ":", "-.")


def moving_mean(values: list[float], window: int) -> NDArray[np.float64]:
    """The mean of the last `window` values (fewer at the start) at every place."""
    sums = np.cumsum([0.0, *values])
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(0, ends - window)
    return np.asarray((sums[ends] - sums[starts]) / (ends - starts))


def draw(folder: RunFolder) -> Path:
    """Draw returns while training, their moving mean, and the evaluations."""
    mpl.use("Agg")
    config = folder.config()
    episodes = read_rows(folder.episodes_file, EpisodeRow)
    evaluations = read_rows(folder.evaluations_file, EvaluationRow)
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for number, level in enumerate(config.mix):
        colour, dash = COLOURS[number % len(COLOURS)], DASHES[number % len(DASHES)]
        ours = [row for row in episodes if row.level == level]
        numbers = [row.episode + 1 for row in ours]
        returns = [row.normalised_return for row in ours]
        axes.plot(numbers, returns, ".", color=colour, alpha=0.25, markersize=3)
        window = min(WINDOW, max(1, len(returns) // 3))
        axes.plot(
            numbers,
            moving_mean(returns, window),
            dash,
            color=colour,
            linewidth=2,
            label=f"{level}: training, mean of last {window}",
        )
        scored = [row for row in evaluations if row.level == level]
        axes.plot(
            [row.episode for row in scored],
            [row.normalised_return for row in scored],
            "D",
            color="black",
            markerfacecolor=colour,
            markersize=6,
            clip_on=False,  # the last one lies on the edge
            label=f"{level}: {config.evaluation.mode} on {config.evaluation.levels} evaluation levels",
        )
    axes.set(
        xlabel="episode",
        ylabel="normalised return",
        ylim=(-1.02, 0.02),
        xlim=(0, config.episodes),
        title=f"{folder.path.name}: {config.algorithm}, seed {config.seed}, lag {config.lag}"
        f"{' (not repeatable)' * config.is_free}",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(folder.curve_file, dpi=120)
    plt.close(figure)
    return folder.curve_file


def main() -> None:
    parser = argparse.ArgumentParser(description="Draws the learning curve of a run.")
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    folder = RunFolder(parser.parse_args().run)
    sys.stdin.read()
    print(draw(folder))  # noqa: T201  (its caller reads the path)


if __name__ == "__main__":
    run_service(main)
