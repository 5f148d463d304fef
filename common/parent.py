"""A process that ends when the one that started it does."""

import ctypes
import os
import signal

PR_SET_PDEATHSIG = 1  # of Linux


def end_with_parent(number: signal.Signals) -> None:
    """Have the kernel send this process a signal when the thread that started it is gone, however it went.

    Raises:
        OSError: the kernel does not.
    """
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, number):
        raise OSError(ctypes.get_errno(), "the kernel binds no process to its parent")


def end_with(parent: int) -> None:
    """Have this process killed when its parent ends, also if that is gone already."""
    end_with_parent(signal.SIGKILL)
    if os.getppid() != parent:  # it ended before the kernel knew
        os.kill(os.getpid(), signal.SIGKILL)
