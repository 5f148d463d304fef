"""SIGTERM, by which batch systems and containers end a command before it is done: as clean an end as Ctrl-C's."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn


class Terminated(KeyboardInterrupt):
    """Not the user but a system asked to stop: the command ends with an error, so that it is started again."""


@contextmanager
def terminable() -> Iterator[None]:
    """Within, SIGTERM raises `Terminated`. Without a handler the first process of a container would not even notice."""
    before = signal.signal(signal.SIGTERM, _raise)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _raise(_number: int, _frame: object) -> NoReturn:
    raise Terminated
