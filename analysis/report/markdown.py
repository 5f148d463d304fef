"""python -m railctl.analysis.report.markdown FILE: the final scores in a file of results, as the documents have them."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from railctl.analysis.report import published
from railctl.analysis.report.loading import load_results
from railctl.analysis.report.results import Results, Scored
from railctl.analysis.report.sections.final import spread
from railctl.analysis.report.tables import NOTHING, Beside, shown


def final_scores(results: Results) -> str:
    """Table 5.2 of the study turned round, in Markdown: a row a contender, then a row a reference policy.

    Mean returns ± their standard deviation over runs, in brackets the study's.
    """
    policies = dict.fromkeys(policy for policy, _level in results.references)
    rows = [
        *(
            [f"`{name}`{_mark(results, name)}", *(_contender(results, name, level) for level in results.levels)]
            for name in results.contenders
        ),
        *([f"`{name}`", *(_policy(results, name, level) for level in results.levels)] for name in policies),
    ]
    return "\n".join(_lines(("", *results.levels), rows))


def _mark(results: Results, name: str) -> str:
    is_free = any(trained.is_free for level in results.levels for trained in results.cell(name, level))
    return " (lag free: not repeatable)" if is_free else ""


def _contender(results: Results, name: str, level: str) -> str:
    scored = [trained.scored for trained in results.cell(name, level) if trained.scored]
    if not scored:
        return NOTHING
    ours = shown(spread(scored), ".3f")
    study = published.final(level, name)
    return shown(Beside(ours, None if study is None else shown(study, ".2f", ".3g")), "")


def _policy(results: Results, name: str, level: str) -> str:
    found: Scored | None = results.references[name, level]
    return NOTHING if found is None else shown(found.mean, ".3f")


def _lines(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    for row in (headings, ["---"] * len(headings), *rows):
        yield f"| {' | '.join(row)} |"


if __name__ == "__main__":
    print(final_scores(load_results(Path(sys.argv[1]))))  # noqa: T201  (that is what it is for)
