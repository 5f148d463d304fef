"""All files of a report in a folder: the page last, so that it is there when everything is."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from railctl.analysis.report.figures.style import image
from railctl.analysis.report.page import page
from railctl.analysis.report.parts import Figure, Section
from railctl.analysis.report.results import Results
from railctl.analysis.report.tables import Table
from railctl.common.folder import write_atomically


def write(
    folder: Path,
    results: Results,
    sections: Sequence[Section],
    judged: dict[str, Any] | None,
    tell: Callable[[int, int], None],
) -> Path:
    """Write every figure as SVG, every table as CSV, all numbers as `report.json`, and the page."""
    figures = _figures(sections)
    tables = [part for section in sections for part in section.parts if isinstance(part, Table)]
    images = {}
    for done, figure in enumerate(figures):
        tell(done, len(figures))
        images[figure.name] = image(figure.drawing, "svg")
        (folder / f"{figure.name}.svg").write_bytes(images[figure.name])
    tell(len(figures), len(figures))
    for table in tables:
        (folder / f"{table.name}.csv").write_text(table.csv())
    text = json.dumps(numbers(results, figures, tables, judged), indent=1, allow_nan=False)
    write_atomically(folder / "report.json", text + "\n")
    path = folder / "report.html"
    write_atomically(path, page(results.title, sections, images))
    return path


def write_png(folder: Path, sections: Sequence[Section], tell: Callable[[int, int], None]) -> None:
    """Write every figure as PNG, for where SVG is not taken."""
    figures = _figures(sections)
    for done, figure in enumerate(figures):
        tell(done, len(figures))
        (folder / f"{figure.name}.png").write_bytes(image(figure.drawing, "png"))
    tell(len(figures), len(figures))


def _figures(sections: Sequence[Section]) -> list[Figure]:
    return [part for section in sections for part in section.parts if isinstance(part, Figure)]


def numbers(
    results: Results, figures: Sequence[Figure], tables: Sequence[Table], judged: dict[str, Any] | None
) -> dict[str, Any]:
    """All that the report shows, and what it was computed from, as plain data; what is not a number is null."""
    runs = [
        {
            **run._asdict(),
            "state": trained.state,
            "reason": trained.reason,
            "episodes": len(trained.returns),
            "block_means": results.block_means(trained).tolist(),
            "score": trained.scored.mean if trained.scored else None,
        }
        for run, trained in results.runs.items()
    ]
    document = {
        "title": results.title,
        "contenders": results.contenders,
        "levels": results.levels,
        "seeds": results.seeds,
        "episodes": results.episodes,
        "judgement": results.judgement.model_dump(),
        "runs": runs,
        "figures": {figure.name: {"title": figure.title, "numbers": figure.numbers} for figure in figures},
        "tables": {table.name: {"title": table.title, "rows": table.records()} for table in tables},
        "reliability": judged,
    }
    found: dict[str, Any] = _finite(document)
    return found


def _finite(value: Any) -> Any:
    """The same without nan and infinities, which JSON has not."""
    if isinstance(value, dict):
        return {key: _finite(inside) for key, inside in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inside) for inside in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
