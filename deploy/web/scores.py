"""Scores on held-out levels that lie in a study's folder, as `railctl evaluate --json` prints them."""

from pathlib import Path
from typing import Any

import numpy as np

from railctl.analysis.statistics import mean_interval
from railctl.analysis.study import StudyFolder
from railctl.common.bounded import read_json
from railctl.common.requests import Reference


def scored(path: Path, level: str, first: int | None = None) -> dict[str, Any] | None:
    """The mean return on a level with its 95% interval; None if nothing of the kind is there.

    Args:
        path: of the document.
        level: a row of it.
        first: only the first so many evaluation levels count, which are those that a run was evaluated on.
    """
    try:
        row = next(row for row in read_json(path)["rows"] if row["level"] == level)
        if first is None or first >= row["levels"]:
            return {"mean": row["mean"], "low": row["low"], "high": row["high"], "levels": row["levels"]}
        returns = np.array(row["returns"][:first], np.float64)
    except (OSError, ValueError, KeyError, TypeError, StopIteration):
        return None
    low, high = mean_interval(returns)
    return {"mean": float(returns.mean()), "low": low, "high": high, "levels": first}


def references_of(folder: StudyFolder, level: str, first: int | None = None) -> dict[Reference, dict[str, Any]]:
    """What reference policies reach on a level, by their names."""
    suffix = f"-{level}.json"
    found = {
        path.name.removesuffix(suffix): scored(path, level, first)
        for path in sorted((folder.path / "references").glob(f"*{suffix}"))
    }
    return {name: score for name, score in found.items() if score is not None}  # type: ignore[misc]
