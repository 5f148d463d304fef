"""YAML files that hold keys: run files, studies, saved configurations."""

from pathlib import Path
from typing import Any

from railctl.common.bounded import read_bounded
from railctl.common.plain_yaml import NotPlainYamlError, parse_yaml
from railctl.common.strict import ConfigError, brief

MOST_BYTES = 256_000


def read_mapping(path: Path, remedy: str, example: str) -> dict[Any, Any]:
    """What a YAML file says.

    Args:
        path: the file.
        remedy: what to do if it cannot be read.
        example: what such a file may say, where it says nothing.

    Raises:
        ConfigError: it cannot be read, or is not a mapping; one line that ends in what to do.
    """
    named = brief(str(path), 200)
    try:
        data = parse_yaml(read_bounded(path, MOST_BYTES).decode())
    except OSError as error:
        raise ConfigError(f"{named} cannot be read: {error.strerror}: {remedy}") from None
    except NotPlainYamlError as error:
        raise ConfigError(f"{named} is not YAML: {error}") from None
    except ValueError:
        raise ConfigError(f"{named} is not YAML: it is no text in UTF-8: {remedy}") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{named} holds no keys: write for example '{example}'")
    return data
