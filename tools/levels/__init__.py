"""Levels built, checked, drawn, exchanged: `python -m tools.levels.tasks`."""
