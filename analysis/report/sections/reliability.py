"""Figures 5.3 to 5.6 and .1 to .4: reliability while training, as rankings."""

from collections.abc import Iterator, Mapping
from typing import Any

from railctl.analysis.report.figures.rankings import Ranking, Rule, rankings
from railctl.analysis.report.figures.style import Look
from railctl.analysis.report.parts import Figure, Part, Section
from railctl.analysis.report.results import Rectangle, Results
from railctl.analysis.report.tables import Cell, Column, Interval, Table

TEXTBOOK, TOOL = "textbook_by_0.05", "by_0.01"
ZONES = ("Beginning", "Middle", "End")
METRICS = {
    "DT": (
        "dispersion across time",
        "the interquartile range of the differences between successive episodes within an evaluation point",
        "5.3",
    ),
    "DR": (
        "dispersion across runs",
        "the interquartile range over runs of the mean return of an evaluation point",
        "5.4",
    ),
    "SRT": ("short-term risk", "the mean of the worst 5% of changes from one evaluation point to the next", "5.5"),
    "LRT": ("long-term risk", "the mean of the worst 5% of falls below the best evaluation point so far", "5.6"),
}

Document = Mapping[str, Any]


def why_not(results: Results, over: Rectangle | None) -> str | None:
    """Why nothing can be ranked, if so."""
    if len(results.contenders) < 2:
        return "Rankings compare contenders, and here is only one: they are left out."
    if over is None:
        lacking = [
            f"{name} on {level}"
            for level in results.levels
            for name in results.contenders
            if not any(map(results.is_whole, results.cell(name, level)))
        ]
        who = f": none is there of {', '.join(lacking)}" if lacking else ""
        return (
            f"Rankings need a seed with which every contender has trained all {results.episodes} episodes of a level, "
            f"and there is none{who}. They are left out until there is."
        )
    if len(over.seeds) < 2:
        return "Rankings need two seeds that all contenders have trained with, and here is one: they are left out."
    least = max(2, results.judgement.zones)
    if results.points < least:
        return f"Rankings need {least} evaluation points of {results.judgement.block} episodes: they are left out."
    return None


def about(results: Results, over: Rectangle) -> str:
    """A sentence on what is compared."""
    seeds, levels = ", ".join(map(str, over.seeds)), ", ".join(over.levels)
    left = len(results.runs) - len(results.contenders) * len(over.seeds) * len(over.levels)
    rest = f" {left} runs are not whole or stand alone, and are left out." if left else ""
    n = f"n = {len(over.seeds)} runs each"
    return f"Compared are the runs that all contenders have: levels {levels}, seeds {seeds} ({n}).{rest}"


def reliability(results: Results, over: Rectangle, judged: Document, styles: Mapping[str, Look]) -> Iterator[Section]:
    """The study's figures of all levels together, then its appendix's, level by level."""
    heading = (
        "The study's four metrics (Chan et al. 2020), as ranks of all runs of all contenders on a level, averaged. The "
        f"score is {len(results.contenders)} + 1 less the mean rank over the number of runs: the higher the more "
        f"reliable. Vertical lines are 95% intervals of {results.judgement.bootstraps} bootstraps. A horizontal line "
        f"joins two contenders that differ significantly ({results.judgement.permutations} permutations, corrected "
        "for all pairs of a panel): by the textbook's Benjamini-Yekutieli at 0.05, by the tool's own rule (0.01, "
        "partial harmonic sums), or by both."
    )
    together = [_figure(over, judged, styles, metric) for metric in METRICS]
    tables = [_scores(results, judged), _pairs(results, judged)]
    yield Section("Reliability", (about(results, over), heading, *together, *tables))
    apart: list[Part] = [_by_level(over, judged, styles, number) for number in range(len(METRICS))]
    yield Section("Reliability, level by level", ("As before, with ranks of one level alone.", *apart))


def rules(stats: Document) -> dict[tuple[int, int], Rule]:
    """Which pairs of a panel differ, and by which rule."""
    textbook, tool = ({(i, j) for i, j in stats["significant"][name]} for name in (TEXTBOOK, TOOL))
    found: dict[tuple[int, int], Rule] = dict.fromkeys(sorted(textbook | tool), "both")
    return found | dict.fromkeys(textbook - tool, "textbook") | dict.fromkeys(tool - textbook, "tool")


def _panel(title: str, stats: Document) -> Ranking:
    n = len(stats["mean_rank"])
    intervals = [(n + 1 - high, n + 1 - low) for low, high in stats["ci95"]]
    return Ranking(title, stats["bar_height"], intervals, rules(stats))


def zone_title(zone: str, zones: int) -> str:
    """What a zone of so many is called.

    >>> zone_title("zone1", 3), zone_title("zone1", 4), zone_title("whole", 3), zone_title("zone0", 1)
    ('Middle', 'Zone 2', 'Whole training', 'Whole training')
    """
    if zone == "whole" or zones == 1:
        return "Whole training"
    number = int(zone.removeprefix("zone"))
    return ZONES[number] if zones == len(ZONES) else f"Zone {number + 1}"


def _panels(stats: Mapping[str, Document], prefix: str = "") -> list[Ranking]:
    return [_panel(prefix + zone_title(zone, len(stats)), found) for zone, found in stats.items()]


def _figure(over: Rectangle, judged: Document, styles: Mapping[str, Look], metric: str) -> Figure:
    name, what, number = METRICS[metric]
    stats = judged["metrics"][metric]["stats"]["all"]
    zones = "in each zone of training" if len(stats) > 1 else "over the whole training"
    caption = (
        f"{metric}: {what}; less of it is better, and ranks higher. Scores {zones}, mean over "
        f"{', '.join(over.levels)}, n = {len(over.seeds)} runs each."
    )
    return Figure(f"figure-{number}", f"Figure {number}: {name}", caption, rankings([_panels(stats)], styles), stats)


def _by_level(over: Rectangle, judged: Document, styles: Mapping[str, Look], number: int) -> Figure:
    metric = list(METRICS)[number]
    name = METRICS[metric][0]
    stats = {level: judged["metrics"][metric]["stats"][f"task{k}"] for k, level in enumerate(over.levels)}
    by_zone = len(next(iter(stats.values()))) > 1
    if by_zone:
        rows = [_panels(zones, f"{level}: ") for level, zones in stats.items()]
    else:
        rows = [[_panel(level, whole) for level, zones in stats.items() for whole in zones.values()]]
    caption = (
        f"As figure {METRICS[metric][2]}, {'a row' if by_zone else 'a panel'} a level. n = {len(over.seeds)} runs each."
    )
    return Figure(
        f"figure-appendix-{number + 1}",
        f"Figure .{number + 1}: {name} by level",
        caption,
        rankings(rows, styles),
        stats,
    )


def _scores(results: Results, judged: Document) -> Table:
    """All bars of the four figures as numbers."""
    found = [
        (f"{metric} {zone_title(zone, len(stats))}" if len(stats) > 1 else metric, _panel("", of_zone))
        for metric in METRICS
        for stats in [judged["metrics"][metric]["stats"]["all"]]
        for zone, of_zone in stats.items()
    ]
    rows: list[list[Cell]] = [
        [name, *(Interval(panel.heights[number], *panel.intervals[number]) for _, panel in found)]
        for number, name in enumerate(results.contenders)
    ]
    columns = (Column("contender"), *(Column(title, ".2f") for title, _ in found))
    return Table("table-scores", "Scores", "The scores of figures 5.3 to 5.6 and their 95% intervals.", columns, rows)


def _pairs(results: Results, judged: Document) -> Table:
    rows: list[list[Cell]] = []
    for metric in METRICS:
        stats = judged["metrics"][metric]["stats"]["all"]
        for zone, of_zone in stats.items():
            differing = rules(of_zone)
            for i, j, _, p, d in of_zone["pairs"]:
                rule = differing.get((i, j), "neither")
                names = results.contenders[i], results.contenders[j]
                rows.append([metric, zone_title(zone, len(stats)), *names, d, p, rule])
    headings = ("metric", "zone", "x", "y")
    columns = (*map(Column, headings), Column("x ahead by", ".2f"), Column("p", ".4f"), Column("differs by"))
    caption = "Every pair of figures 5.3 to 5.6: by how many ranks x is ahead of y, p of the permutation test, and by "
    caption += "which rules they differ."
    return Table("table-pairs", "Pairs", caption, columns, rows, is_folded=True)
