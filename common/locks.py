"""One process of a name in a run or a study, told by kernel locks: a dead process holds none.

The folder may be one that several machines or containers share: locks hold on all of them, pids on one.
"""

import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
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
                    host = _host(_content(folder, name))
                    where = f"as process {holder(folder, name)}" if host is None else f"on {host}"
                    raise RunsAlreadyError(f"{name} of {folder.path.name} runs already, {where}") from None
                time.sleep(STRETCH_S)
        file.truncate(0)
        file.write(f"{os.getpid()} {socket.gethostname()} {_machine()}")
        file.flush()
        yield


def holder(folder: Folder, name: str) -> int | None:
    """The pid of the living process of this name on this machine, whoever started it, or none."""
    content = _content(folder, name)
    pid = content[0] if content and _host(content) is None else ""
    return int(pid) if pid.isdigit() and _lives(int(pid)) else None


def elsewhere(folder: Folder) -> str | None:
    """The name of another machine or container whose processes work in the folder, or none."""
    return next((host for path in _files(folder) if (host := _host(_content(folder, path.name))) is not None), None)


def _content(folder: Folder, name: str) -> list[str]:
    """What the holder of a name has written of itself: its pid, and where that means something."""
    path = folder.processes / name
    if not path.is_file():
        return []  # opening a named pipe would wait for ever
    try:
        with path.open("r") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return file.read().split()
    except (FileNotFoundError, NotADirectoryError):
        pass
    return []


def _host(content: list[str]) -> str | None:
    """The other machine or container that a holder lives on; those of earlier versions said nothing of it."""
    return content[1] if len(content) == 3 and content[2] != _machine() else None


@cache
def _machine() -> str:
    """What tells this machine, and this container on it, from others."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}/{Path('/proc/self/ns/pid').stat().st_ino}"
    except OSError:  # no Linux, so no containers either
        return socket.gethostname()


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
    """Name and pid of every living process of the folder on this machine."""
    pids = {path.name: holder(folder, path.name) for path in _files(folder)}
    return {name: pid for name, pid in pids.items() if pid is not None}


def _files(folder: Folder) -> list[Path]:
    return sorted(folder.processes.iterdir()) if folder.processes.is_dir() else []
