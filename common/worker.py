"""python -m common.worker PID MODULE ARGUMENTS: a module that ends, whatever it does, when its parent, PID, does.

The kernel sees to it: what computes for hours in compiled code hears of no signal that Python would handle, of no pipe
and of no thread. It kills when the thread ends that started this process, so that shall be the parent's main thread.
"""

import ctypes
import os
import runpy
import signal
import sys

PR_SET_PDEATHSIG = 1


def end_with(parent: int) -> None:
    """Have this process killed when its parent ends, also if that is gone already."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL):
        raise OSError(ctypes.get_errno(), "the kernel binds no process to its parent")
    if os.getppid() != parent:  # it ended before the kernel knew
        os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    _, parent, module, *arguments = sys.argv
    end_with(int(parent))
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
