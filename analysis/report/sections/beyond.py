"""Beyond the study: robust aggregates of the final evaluation, comparisons, and what rankings hang on."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import false_discovery_control

from railctl.analysis import aggregates as statistics
from railctl.analysis.report.figures.estimates import dots, matrix
from railctl.analysis.report.figures.lines import Line, panels
from railctl.analysis.report.figures.style import Look
from railctl.analysis.report.parts import Figure, Part, Section
from railctl.analysis.report.results import Rectangle, Results
from railctl.analysis.report.sections.reliability import zone_title
from railctl.analysis.report.sections.training import OPTIMAL
from railctl.analysis.report.tables import NOTHING, Cell, Column, Interval, Table

TITLE = "Beyond the study"
TAUS = np.linspace(-1, 0, 101)
CHANGED = {True: "yes", False: "no", None: NOTHING}
Scores = Mapping[str, NDArray[np.float64]]


def beyond(
    results: Results,
    curves: Rectangle | None,
    sensitivity: Sequence[Mapping[str, Any]] | None,
    styles: Mapping[str, Look],
) -> Section:
    """In the order of the specification; what cannot be had is left out with its reason."""
    parts: list[Part] = []
    over = results.rectangle(lambda trained: trained.scored is not None)
    if over is None:
        parts.append(
            "No seed has a final score of every contender on a level: aggregates of final scores are left out."
        )
    else:
        scores = results.scores(over)
        parts.append(_about(over, results.scored_by))
        parts += [*_aggregates(scores, styles, over), *_improvement(scores), _profiles(scores, styles, over)]
    if curves is not None and results.points > 0:
        parts.append(_iqm_curves(results, curves, styles))
    if over is not None:
        parts += [*_ranks(scores), *_paired(scores, over)]
    if sensitivity is not None:
        parts.append(_sensitivity(results, sensitivity))
    return Section(TITLE, tuple(parts))


def _about(over: Rectangle, scored_by: str) -> str:
    few = " Of a single run nothing can be said about others: there are no intervals." if len(over.seeds) == 1 else ""
    return (
        f"Final scores ({scored_by}) that all contenders have: levels {', '.join(over.levels)}, seeds "
        f"{', '.join(map(str, over.seeds))} (n = {len(over.seeds)} runs each). Methods are those of Agarwal et al. "
        f"(2021); intervals are of 95%, by a bootstrap over runs within levels.{few}"
    )


def _aggregates(scores: Scores, styles: Mapping[str, Look], over: Rectangle) -> Iterator[Part]:
    found = statistics.aggregates(scores, optimal=OPTIMAL)
    shown = {key: {name: Interval(*of[key]) for name, of in found.items()} for key in ("iqm", "optimality_gap")}
    titles = {"iqm": "interquartile mean (right is better)", "optimality_gap": "optimality gap (left is better)"}
    drawing = dots({titles[key]: estimates for key, estimates in shown.items()}, styles)
    caption = (
        "Left: the mean of the middle half of all final scores, which outliers do not move. Right: by how much scores "
        f"lie below {OPTIMAL}, the study's score of optimal agents. Bars are 95% intervals. "
        f"n = {len(over.seeds)} runs on each level."
    )
    numbers = {name: {key: estimate._asdict() for key, estimate in of.items()} for name, of in found.items()}
    yield Figure("figure-iqm", "Interquartile mean and optimality gap", caption, drawing, numbers)
    keys = ("mean", "median", "iqm", "optimality_gap")
    rows: list[list[Cell]] = [[name, *(Interval(*of[key]) for key in keys)] for name, of in found.items()]
    columns = (Column("contender"), *(Column(key.replace("_", " ")) for key in keys))
    caption = "Aggregates of final scores over levels and runs; the median is that of the levels' means."
    yield Table("table-aggregates", "Aggregates", caption, columns, rows)


def _improvement(scores: Scores) -> Iterator[Figure]:
    if len(scores) < 2:
        return
    found, names = statistics.probability_of_improvement(scores), list(scores)
    values = np.array([[found[x, y].value if x != y else np.nan for y in names] for x in names])
    texts = [[_estimate(found[x, y]) if x != y else "" for y in names] for x in names]
    numbers = {x: {y: found[x, y]._asdict() for y in names if x != y} for x in names}
    caption = (
        "How probable it is that a run of the row is better than a run of the column on the same level, with its 95% "
        "interval. 0.5 is even; an interval that does not hold it is a difference. The darker the more probable."
    )
    drawing = matrix(values, names, names, texts, "is beaten by the row")
    yield Figure("figure-improvement", "Probability of improvement", caption, drawing, numbers)


def _estimate(estimate: statistics.Estimate) -> str:
    value, low, high = estimate
    return f"{value:.2f}" if np.isnan(low) else f"{value:.2f}\n[{low:.2f}, {high:.2f}]"


def _profiles(scores: Scores, styles: Mapping[str, Look], over: Rectangle) -> Figure:
    found = statistics.performance_profiles(scores, TAUS)
    lines = {", ".join(over.levels): {name: Line(TAUS, *of) for name, of in found.items()}}
    axes = {"xlabel": "score", "ylabel": "share of runs above", "xlim": (-1, 0), "ylim": (-0.02, 1.02)}
    caption = (
        "Which share of the runs, over all levels, scores above a value: a line above another's at every value is "
        "better whatever one aims for. Shaded: 95% intervals, at each value alone."
    )
    drawing = panels(lines, styles, axes, ends_meet=True)
    return Figure("figure-profiles", "Performance profiles", caption, drawing, _numbers(lines))


def _iqm_curves(results: Results, over: Rectangle, styles: Mapping[str, Look]) -> Figure:
    n = len(over.seeds)
    returns = results.returns(over)
    means = returns.reshape(*returns.shape[:3], results.points, results.judgement.block).mean(axis=4)
    found = statistics.iqm_curves(
        {name: means[number].transpose(1, 0, 2) for number, name in enumerate(results.contenders)}
    )
    episodes = results.judgement.block * np.arange(1.0, results.points + 1)
    lines = {", ".join(over.levels): {name: Line(episodes, *of) for name, of in found.items()}}
    axes = {
        "xlabel": "episode",
        "ylabel": "interquartile mean return",
        "xlim": (0, results.episodes),
        "ylim": (-1.02, 0.02),
    }
    caption = (
        f"The interquartile mean, over runs and levels, of the mean return of {results.judgement.block} training "
        f"episodes; shaded: 95% intervals. n = {n} runs on each level."
    )
    return Figure(
        "figure-iqm-curves", "Interquartile mean over episodes", caption, panels(lines, styles, axes), _numbers(lines)
    )


def _numbers(lines: Mapping[str, Mapping[str, Line]]) -> dict[str, Any]:
    [of] = lines.values()
    return {
        name: {"x": line.x.tolist(), "y": line.y.tolist(), "low": line.low.tolist(), "high": line.high.tolist()}
        for name, line in of.items()
    }


def _ranks(scores: Scores) -> Iterator[Part]:
    found, names = statistics.rank_distribution(scores), list(scores)
    values = np.array([found[name] for name in names])
    if len(names) < 2 or np.isnan(values).any():
        yield "How probable each rank is cannot be said of one contender, or from one run: it is left out."
        return
    texts = [[f"{share:.0%}" for share in row] for row in values]
    ranks = [str(rank + 1) for rank in range(len(names))]
    caption = (
        "How probable each rank is by the mean final score on a level, mean over levels, if seeds were drawn anew: the "
        "same for all contenders. Rank 1 is the best; a row of one dark cell is a rank to rely on."
    )
    drawing = matrix(values, names, ranks, texts, "rank")
    yield Figure("figure-ranks", "Rank distribution", caption, drawing, {name: found[name].tolist() for name in names})


def _paired(scores: Scores, over: Rectangle) -> Iterator[Part]:
    if len(scores) < 2 or len(over.seeds) < 2:
        yield "A paired test needs two contenders and two seeds at least: it is left out."
        return
    pairs = list(combinations(scores, 2))
    tests = [statistics.paired_test(scores[x], scores[y]) for x, y in pairs]
    corrected = false_discovery_control([test.p for test in tests], method="by")
    rows: list[list[Cell]] = [
        [x, y, Interval(test.difference, test.low, test.high), test.p, float(p)]
        for (x, y), test, p in zip(pairs, tests, corrected, strict=True)
    ]
    caption = (
        "Contenders with the same seed saw the same levels while training, so they are compared seed by seed: the mean "
        "difference x - y of final scores with its 95% interval, p of a sign-flip permutation test, and p corrected "
        f"for all pairs (Benjamini-Yekutieli). n = {len(over.seeds)} seeds on {len(over.levels)} levels."
    )
    columns = (Column("x"), Column("y"), Column("x - y"), Column("p", ".4f"), Column("p corrected", ".4f"))
    yield Table("table-paired", "Paired tests within seeds", caption, columns, rows)


def _sensitivity(results: Results, found: Sequence[Mapping[str, Any]]) -> Table:
    rows: list[list[Cell]] = [
        [
            row["metric"],
            zone_title(row["zone"], results.judgement.zones),
            row["switch"],
            str(row["value"]).lower(),  # as it is given
            *map(float, row["mean_rank"]),  # "nan" where there are none
            CHANGED[row["order_changed"]],
        ]
        for row in found
    ]
    columns = (
        *map(Column, ("metric", "zone", "switch", "value")),
        *(Column(name, ".2f") for name in results.contenders),
        Column("order changed"),
    )
    caption = (
        "Mean ranks (1 is the best) if one choice in computing the metrics is made otherwise, all others being as "
        "above, and whether that changes the order of contenders: a ranking that turns with a switch says little."
    )
    return Table("table-sensitivity", "Sensitivity of rankings", caption, columns, rows)
