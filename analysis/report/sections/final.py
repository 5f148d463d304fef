"""Table 5.2: the final evaluation."""

from collections.abc import Iterator

import numpy as np

from railctl.analysis.report import published
from railctl.analysis.report.parts import Part, Section
from railctl.analysis.report.results import Results, Scored
from railctl.analysis.report.tables import Cell, Column, Spread, Table

TITLE = "Final evaluation"
COLUMNS = (
    Column("level"),
    Column("contender"),
    Column("runs"),
    Column("return"),
    Column("study's return", ".2f", ".3g"),
    Column("median episode"),
    Column("trains arrived", ".1%"),
    Column("all arrived", ".1%"),
)


def final(results: Results) -> Section:
    """Contenders, the study's figures, and reference policies."""
    rows = [row for level in results.levels for row in _level(results, level)]
    if not rows:
        return Section(TITLE, ("Nothing has been scored yet.",))
    parts: list[Part] = [Table("table-5.2", "Table 5.2: final evaluation", _caption(results), COLUMNS, rows)]
    parts += [
        note for level in results.levels for name in results.contenders if (note := published.misprints(level, name))
    ]
    return Section(TITLE, (*parts, *_best(results)))


def _level(results: Results, level: str) -> Iterator[list[Cell]]:
    for name in results.contenders:
        scored = [trained.scored for trained in results.cell(name, level) if trained.scored]
        if scored:
            yield [level, name, len(scored), spread(scored), published.final(level, name), *_shares(scored)]
    for (policy, of_level), found in results.references.items():
        if of_level == level and found:
            yield [level, policy, None, Spread(found.mean, None), None, *_shares([found])]


def spread(scored: list[Scored]) -> Spread:
    """The mean return of runs, and its standard deviation over them if there are several."""
    means = [each.mean for each in scored]
    return Spread(float(np.mean(means)), float(np.std(means, ddof=1)) if len(means) > 1 else None)


def _shares(scored: list[Scored]) -> list[float | None]:
    returns = np.concatenate([each.returns for each in scored])
    return [
        float(np.median(returns)) if len(returns) else None,
        float(np.mean([each.arrived_share for each in scored])),
        float(np.mean([each.all_arrived_share for each in scored])),
    ]


def _caption(results: Results) -> str:
    episodes = {trained.scored.levels for trained in results.runs.values() if trained.scored}
    each = f"{min(episodes)}" if len(episodes) == 1 else f"{min(episodes, default=0)} to {max(episodes, default=0)}"
    return (
        f"Scores are those of {results.scored_by} ({each} levels a run). Return: mean over runs ± their standard "
        "deviation (of a sample), beside the study's (ten runs of 1500 episodes). Episodes end either well or in a "
        "jam, so their median, over all episodes of all runs, is often far from the mean; the shares say how many "
        "trains arrived, and in how many episodes all of them. Rows without a number of runs are reference policies, "
        "which do not learn."
    )


def _best(results: Results) -> Iterator[str]:
    """A sentence on who came first."""
    found = []
    for level in results.levels:
        scores = {
            name: spread(scored).mean
            for name in results.contenders
            if (scored := [trained.scored for trained in results.cell(name, level) if trained.scored])
        }
        if len(scores) > 1:
            best = max(scores, key=lambda name: scores[name])
            found.append(f"{best} on {level} ({scores[best]:.3f})")
    if found:
        yield f"The best mean returns: {', '.join(found)}."
