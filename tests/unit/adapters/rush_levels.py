"""Levels with stock rules that are drawn in moments, and what run files say of them."""

from railctl.common.levels.distributions import StockLevels
from railctl.common.levels.generate import generate

RUSH = {
    "rules": "stock",
    "size": [24, 22],
    "trains": 4,
    "cities": 2,
    "speeds": {1.0: 0.5, 0.5: 0.3, 0.33: 0.2},
    "malfunctions": {"rate": 0.03, "min_steps": 3, "max_steps": 12},
    "held_out": 3,
}


def rush_level(seed, **changed):
    """A level with slow trains, malfunctions and a timetable."""
    return generate(StockLevels.model_validate(RUSH | changed), seed)
