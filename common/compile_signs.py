"""Whether this process is compiling: for its heartbeat and its progress, known without importing a compiler.

Compiling takes a minute where nothing is compiled yet, in which the process's own loop stands still. Waiting for
another process that compiles the same function counts as well.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager

COMPILING = "compiling, the first time only"

Around = Callable[[str], AbstractContextManager[None]]

_arounds: list[Around] = []
_open: list[str] = []  # functions that are being compiled, each for the one before; one thread compiles at a time


@contextmanager
def compiling(function: str) -> Iterator[None]:
    """A function is compiled for as long as the block lasts, together with those that it calls."""
    with ExitStack() as stack:
        if not _open:
            for around in _arounds:
                stack.enter_context(around(function))
        _open.append(function)
        stack.callback(_open.pop)
        yield


@contextmanager
def around_compiling(around: Around) -> Iterator[None]:
    """For as long as the block lasts, `around(function)` is entered while this process compiles."""
    _arounds.append(around)
    try:
        yield
    finally:
        _arounds.remove(around)
