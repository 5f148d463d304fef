"""A report, put together: what can be computed from the results, and the sections in the study's order."""

from collections.abc import Callable
from typing import Any

from railctl.analysis.reliability import Curves, judge, sensitivity
from railctl.analysis.report.figures.style import looks
from railctl.analysis.report.parts import Section
from railctl.analysis.report.results import Results
from railctl.analysis.report.sections.beyond import beyond
from railctl.analysis.report.sections.final import final
from railctl.analysis.report.sections.reliability import METRICS, reliability, why_not
from railctl.analysis.report.sections.settings import settings
from railctl.analysis.report.sections.summary import summary
from railctl.analysis.report.sections.training import training

STAGES = 6


def contents(results: Results, tell: Callable[[int], None]) -> tuple[list[Section], dict[str, Any] | None]:
    """All sections, and the document of reliability, if there can be one; `tell` is told how many stages are done."""
    styles = looks(results.contenders)
    over = results.rectangle(results.is_whole)
    reason = why_not(results, over)
    tell(0)
    sections = [summary(results), training(results, styles)]
    tell(1)
    judged, switched = None, None
    if over is None or reason:
        sections.append(Section("Reliability", (reason or "",)))
    else:
        asked = results.judgement
        curves = Curves(results.returns(over), asked.block, asked.zones, results.contenders, over.levels)
        judged = judge(curves, bootstraps=asked.bootstraps, permutations=asked.permutations, keys=tuple(METRICS))
        tell(2)
        switched = sensitivity(curves)
        tell(3)
        sections += reliability(results, over, judged, styles)
    tell(4)
    sections += [final(results), settings(results)]
    tell(5)
    sections.append(beyond(results, over, switched, styles))
    tell(STAGES)
    return sections, judged
