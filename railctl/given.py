"""Arguments that shall be text or a file's path; whatever else is given is refused in a line."""

from pathlib import Path
from typing import Any

from railctl.common.strict import ConfigError, shortened


def text_of(argument: str, value: Any) -> str | None:
    """The text, or None if the argument is not given."""
    if not isinstance(value, str | None):
        raise ConfigError(f"{argument}={shortened(value)}: give text")
    return value


def path_of(argument: str, value: Any) -> Path | None:
    """The path, or None if the argument is not given."""
    if not isinstance(value, str | Path | None):
        raise ConfigError(f"{argument}={shortened(value)}: give the path of a file")
    return None if value is None else Path(value)
