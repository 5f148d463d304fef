"""What the study printed: its tables 5.2 and 5.3, in `published.json`."""

import json
from functools import cache
from importlib.resources import files
from typing import Any

from railctl.analysis.report.tables import Spread

HYPERPARAMETERS = ("learning rate", "hidden", "batch", "learn every", "buffer", "epochs")


@cache
def _published() -> dict[str, Any]:
    text = (files("railctl.analysis.report") / "published.json").read_text()
    document: dict[str, Any] = json.loads(text)
    return document


def final(level: str, algorithm: str) -> Spread | None:
    """The study's final evaluation of an algorithm, if it has it."""
    found = _published()["final"].get(level, {}).get(algorithm)
    return Spread(*found) if found else None


def misprints(level: str, algorithm: str) -> str | None:
    """What is wrong with that, if anything."""
    text: str | None = _published()["misprints"].get(f"{level} {algorithm}")
    return text


def hyperparameters(level: str, algorithm: str) -> dict[str, str]:
    """The study's hyperparameters of an algorithm; none if it does not have it."""
    found: dict[str, str] = _published()["hyperparameters"].get(level, {}).get(algorithm, {})
    return found
