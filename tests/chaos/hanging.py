"""A process that hangs: its own thread stands still, while those of its libraries go on and say that it lives.

A signal would stop all threads; a tracer stops one. Linux alone.
"""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

PTRACE_DETACH, PTRACE_SEIZE, PTRACE_INTERRUPT = 17, 0x4206, 0x4207
WALL = 0x40000000  # for any kind of child

_libc = ctypes.CDLL(None, use_errno=True)
_libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]


@contextmanager
def hung(pid: int) -> Iterator[None]:
    """The main thread of a process stands still within, unless the process ends.

    Raises:
        OSError: it may not be traced.
    """
    _trace(PTRACE_SEIZE, pid)
    _trace(PTRACE_INTERRUPT, pid)
    os.waitpid(pid, WALL)  # until it stands still
    try:
        yield
    finally:
        try:
            _trace(PTRACE_DETACH, pid)
        except OSError:  # it was killed, which its parent learns only when its tracer has
            with suppress(ChildProcessError):
                os.waitpid(pid, WALL)


def _trace(request: int, pid: int) -> None:
    if _libc.ptrace(request, pid, None, None) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"process {pid} may not be traced: {os.strerror(number)}")
