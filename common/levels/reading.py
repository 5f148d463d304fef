"""Levels out of a file of any kind: ours (.npz), or flatland-rl's (.pkl, .mpk)."""

from pathlib import Path
from typing import NamedTuple

from railctl.common.bounded import open_at_once
from railctl.common.levels import files
from railctl.common.levels.files import ARCHIVE, Groups
from railctl.common.levels.flatland.reading import read_level
from railctl.common.levels.level import Level

DOCUMENTS = {*range(0x80, 0x90), 0xDE, 0xDF}  # begin a pickle, and a dictionary in msgpack


class ReadFile(NamedTuple):
    """What is in a file.

    Attributes:
        groups: levels by the name of their group; one without a name is named after its shape.
        left_out: what the file says and levels cannot, a line each.
    """

    groups: Groups
    left_out: list[str]


def read(path: Path) -> ReadFile:
    """Read a file of levels.

    Raises:
        LevelFileError: it cannot be read, or something in it is no level.
    """
    begin = _beginning(path)
    if begin == ARCHIVE or (path.suffix == ".npz" and begin[:1] not in {bytes([first]) for first in DOCUMENTS}):
        return ReadFile(files.load(path), [])
    found = read_level(path)
    return ReadFile({shape_name(found.level): [found.level]}, found.left_out)


def shape_name(level: Level) -> str:
    """What a level is called that has no name."""
    height, width = level.grid.shape
    return f"{height}x{width}_{level.n_trains}_train{'' if level.n_trains == 1 else 's'}"


def _beginning(path: Path) -> bytes:
    try:
        with open_at_once(path) as file:
            return file.read(len(ARCHIVE))
    except OSError:
        return b""
