"""Paths of files that runs and studies name, made whole: what starts from another folder finds the same files."""

from pathlib import Path
from typing import Any

from railctl.common.config import PATHS, Plain


def levels_with_whole_paths(levels: Plain, base: Path) -> Plain:
    """What a run file says under `levels`, with paths that started from `base`."""
    return {name: _whole_paths(own, base) if isinstance(own, dict) else own for name, own in levels.items()}


def _whole_paths(own: Plain, base: Path) -> Plain:
    def whole(value: Any) -> Any:
        if isinstance(value, list):
            return [whole(one) for one in value]
        return str(base / value) if isinstance(value, str) else value

    return {key: whole(value) if key in ("files", "evaluation") else value for key, value in own.items()}


def with_whole_paths(given: Plain, base: Path) -> Plain:
    """What a run file says, once it has been checked, with paths that started from `base`."""
    found = dict(given)
    if "levels" in given:
        found["levels"] = levels_with_whole_paths(given["levels"], base)
    for key, file in PATHS.items():
        if (section := given.get(key)) is not None:
            section = {file: section} if isinstance(section, str) else section
            found[key] = section | {file: str(base / section[file])}
    return found


def files_of(given: Plain) -> list[str]:
    """The keys under which a run file that has been checked names files."""
    levels = [f"levels.{name}" for name, own in given.get("levels", {}).items() if "files" in own]
    return levels + [key for key in PATHS if given.get(key) is not None]
