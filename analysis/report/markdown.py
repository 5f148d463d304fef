"""python -m railctl.analysis.report.markdown FILE: tables of a file of results, as documents have them."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from scipy.stats import false_discovery_control

from railctl.analysis.aggregates import paired_test
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


def effects(results: Results) -> str:
    """What each change alone does, in Markdown: a row a contender that stands beside its plain algorithm, seed by seed.

    The mean difference of final scores, contender less algorithm, with its 95% interval (bootstrap over seeds), on each
    level and over all; p of a sign-flip test over all, corrected for all rows (Benjamini-Yekutieli).
    """
    over = results.rectangle(lambda trained: trained.scored is not None)
    changed = {name: algorithm for name in results.contenders if (algorithm := _algorithm(results, name)) != name}
    if over is None or len(over.seeds) < 2:
        return ""
    scores = results.scores(over)
    compared = {name: (scores[name], scores[base]) for name, base in changed.items() if base in scores}
    if not compared:
        return ""
    overall = {name: paired_test(*pair) for name, pair in compared.items()}
    corrected = false_discovery_control([test.p for test in overall.values()], method="by")
    rows = []
    for (name, (ours, base)), p in zip(compared.items(), corrected, strict=True):
        apart = [paired_test(ours[:, [place]], base[:, [place]]) for place in range(len(over.levels))]
        cells = [f"{test.difference:+.3f} [{test.low:+.3f}, {test.high:+.3f}]" for test in (*apart, overall[name])]
        rows.append([f"`{name}`", *cells, f"{p:.3f}"])
    return "\n".join(_lines(("", *over.levels, "all", "p"), rows))


def _algorithm(results: Results, name: str) -> str:
    configs = (trained.config for level in results.levels for trained in results.cell(name, level))
    return next((config.algorithm for config in configs if config is not None), name)


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
    found = load_results(Path(sys.argv[1]))
    print(f"{final_scores(found)}\n\n{effects(found)}")  # noqa: T201  (that is what it is for)
