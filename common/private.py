"""What of a run nobody but its user reaches: the socket on which its router listens, its folder, its files.

A loopback port is open to every user of the machine. A socket in a folder of its owner's alone is not: the system
itself refuses others, and no word has to be kept secret. It lies outside the run's folder, for a socket's path may
have a hundred bytes at most, and some file systems have no sockets.
"""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LINK = "unixsock-stream/"
FOLDER_MODE = 0o700
OTHERS = 0o077  # what they may do


@contextmanager
def private_files() -> Iterator[None]:
    """Files and folders that this process makes within are its user's alone."""
    before = os.umask(OTHERS)
    try:
        yield
    finally:
        os.umask(before)


def private_endpoint() -> str:
    """Where a router may listen, for Zenoh: in a folder that is made for it.

    Raises:
        OSError: the folder cannot be made.
    """
    return f"{LINK}{tempfile.mkdtemp(prefix='railctl-')}/router"


def is_private(endpoint: str) -> bool:
    """Whether it is in a folder that is there and that nobody else can enter."""
    if not endpoint.startswith(LINK):
        return False
    try:
        found = _folder(endpoint).lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & OTHERS


def remove_endpoint(endpoint: str) -> None:
    """Remove the socket, if it is there, and its folder."""
    if is_private(endpoint):
        folder = _folder(endpoint)
        with suppress(OSError):
            for path in folder.iterdir():
                path.unlink()
            folder.rmdir()


def _folder(endpoint: str) -> Path:
    return Path(endpoint.removeprefix(LINK)).parent
