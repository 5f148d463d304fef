"""Reading files that others may have written: never more than is expected of them, and without waiting for anybody."""

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any, BinaryIO

MOST_DOCUMENT_BYTES = 64_000_000  # of a JSON document


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """The content of a file of at most so many bytes; a named pipe that nobody writes to is empty.

    Raises:
        OSError: it cannot be read, or is larger.
    """
    with open_at_once(path) as file:
        status = os.fstat(file.fileno())
        expected = min(status.st_size, most_bytes) if stat.S_ISREG(status.st_mode) else most_bytes
        content = file.read(expected + 1)  # which takes as much memory at once
    if len(content) > most_bytes:
        raise OSError(errno.EOVERFLOW, f"larger than {most_bytes / 1e6:g} MB", str(path))
    return content


def read_json(path: Path, most_bytes: int = MOST_DOCUMENT_BYTES) -> Any:
    """The JSON document in a file.

    Raises:
        OSError: as `read_bounded`.
        ValueError: it holds none.
    """
    return parse_json(read_bounded(path, most_bytes))


def parse_json(text: str | bytes) -> Any:
    """A JSON document; raises ValueError if it is none, or one that is nested without end."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def open_at_once(path: Path) -> BinaryIO:
    """A file to read from; a named pipe that nobody writes to is empty, where `Path.open` waits for ever."""
    file = open(path, "rb", opener=_without_waiting)  # noqa: SIM115  (that of Path takes no opener)
    os.set_blocking(file.fileno(), True)
    return file


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)
