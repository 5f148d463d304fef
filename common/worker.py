"""python -m railctl.common.worker PID MODULE ARGUMENTS: a module that ends, whatever it does, when its parent, PID, does.

The kernel sees to it: what computes for hours in compiled code hears of no signal that Python would handle, of no pipe
and of no thread. It kills when the thread ends that started this process, so that shall be the parent's main thread.
"""

import runpy
import sys

from railctl.common.parent import end_with


def main() -> None:
    _, parent, module, *arguments = sys.argv
    end_with(int(parent))
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
