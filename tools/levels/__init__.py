"""Levels built, checked, drawn, exchanged: `python -m railctl.tools.levels.tasks`."""
