"""YAML files that hold keys: run files, studies, saved configurations."""

from pathlib import Path
from typing import Any

import yaml

from common.strict import ConfigError


def read_mapping(path: Path, remedy: str, example: str) -> dict[Any, Any]:
    """What a YAML file says.

    Args:
        path: the file.
        remedy: what to do if it cannot be read.
        example: what such a file may say, where it says nothing.

    Raises:
        ConfigError: it cannot be read, or is not a mapping; one line that ends in what to do.
    """
    try:
        data = yaml.safe_load(path.read_text())
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}: {remedy}") from None
    except (yaml.YAMLError, ValueError) as error:  # ValueError: no text, or a date or number that cannot be
        raise ConfigError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{path} holds no keys: write for example '{example}'")
    return data
