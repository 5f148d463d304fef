"""One process of a name in a run or a study, told by kernel locks: a dead process holds none."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

PATIENCE_S = 2.0  # a probe by another process holds the lock for an instant
STRETCH_S = 0.02


class Folder(Protocol):
    """Something that processes work for."""

    @property
    def path(self) -> Path: ...

    @property
    def processes(self) -> Path: ...


class RunsAlreadyError(Exception):
    """Another process has the name."""


@contextmanager
def sole(folder: Folder, name: str) -> Iterator[None]:
    """Be the only process of this name there for as long as the block lasts; the kernel frees a dead one's lock.

    Raises:
        RunsAlreadyError: another process has the name.
    """
    folder.processes.mkdir(exist_ok=True)
    with (folder.processes / name).open("a+") as file:
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise RunsAlreadyError(
                        f"{name} of {folder.path.name} runs already, as process {holder(folder, name)}"
                    ) from None
                time.sleep(STRETCH_S)
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield


def holder(folder: Folder, name: str) -> int | None:
    """The pid of the living process of this name, whoever started it, or none."""
    try:
        with (folder.processes / name).open("r") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                content = file.read()
                return int(content) if content.isdigit() and _lives(int(content)) else None
    except FileNotFoundError:
        pass
    return None


def _lives(pid: int) -> bool:
    """False for a pid that a dead holder left behind, in the instant before the new holder writes its own."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def living(folder: Folder) -> dict[str, int]:
    """Name and pid of every living process of the folder."""
    if not folder.processes.is_dir():
        return {}
    pids = {path.name: holder(folder, path.name) for path in sorted(folder.processes.iterdir())}
    return {name: pid for name, pid in pids.items() if pid is not None}
