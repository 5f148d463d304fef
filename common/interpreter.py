"""How every process of ours is started: the same interpreter, to which the working directory is no place of modules.

Without `-P` a user's own `random.py` or `common/` would be imported instead of the standard library's, or of ours.
"""

import os
import sys

PYTHON = (sys.executable, "-P")


def run_module(name: str, *arguments: str) -> list[str]:
    """The command that runs a module.

    >>> run_module("railctl.services.router", "--run", "runs/demo")[1:]
    ['-P', '-m', 'railctl.services.router', '--run', 'runs/demo']
    """
    return [*PYTHON, "-m", name, *arguments]


def run_worker(name: str, *arguments: str) -> list[str]:
    """The command that runs a module for this process: it ends when this one does, however that ends."""
    return run_module("railctl.common.worker", str(os.getpid()), name, *arguments)
