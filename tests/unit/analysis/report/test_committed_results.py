"""The results that are kept with the project: tables and documents say what the curves and scores in them come to."""

from pathlib import Path

import pytest

from railctl.analysis.report.loading import load_results
from railctl.analysis.report.markdown import effects, final_scores
from railctl.analysis.report.sections.final import final
from railctl.analysis.report.sections.settings import settings
from railctl.analysis.report.sections.summary import summary
from railctl.analysis.report.tables import Table

ROOT = Path(__file__).parents[4]
RESULTS = sorted((ROOT / "results").glob("*/results.json.xz"))


@pytest.mark.parametrize("path", RESULTS, ids=lambda path: path.parent.name)
def test_tables_are_those_of_the_results(path):
    results = load_results(path)
    tables = [
        part for section in (summary, final, settings) for part in section(results).parts if isinstance(part, Table)
    ]
    assert {table.name for table in tables} >= {"table-5.2", "table-5.3"}
    for table in tables:
        assert (path.parent / f"{table.name}.csv").read_text() == table.csv(), table.name


@pytest.mark.parametrize("path", RESULTS, ids=lambda path: path.parent.name)
def test_the_page_has_the_final_scores(path):
    assert final_scores(load_results(path)) in (ROOT / "docs" / "results.md").read_text()


def test_the_page_has_the_effect_of_each_reading():
    found = effects(load_results(ROOT / "results" / "thesis-ablation" / "results.json.xz"))
    assert found.count("\n") == 24
    assert found in (ROOT / "docs" / "results.md").read_text()


def test_results_are_small():
    assert sum(path.stat().st_size for path in (ROOT / "results").rglob("*") if path.is_file()) < 25_000_000
