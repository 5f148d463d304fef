"""SIGTERM, by which batch systems and containers end a command before it is done: as clean an end as Ctrl-C's."""

import signal
from collections.abc import Iterator, Sequence
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


@contextmanager
def never_missed() -> Iterator[Sequence[KeyboardInterrupt]]:
    """As `terminable`, but what a signal raises is raised at the end of the block if it was lost within.

    Python ignores what is raised in the callback of a weak reference or in `__del__`, and goes on.

    Yields:
        What came: a long block shall look at it.
    """
    came: list[KeyboardInterrupt] = []

    def on_signal(number: int, _frame: object) -> NoReturn:
        came.append(Terminated() if number == signal.SIGTERM else KeyboardInterrupt())
        raise came[-1]

    before = {number: signal.signal(number, on_signal) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        raise came[0]


def _raise(_number: int, _frame: object) -> NoReturn:
    raise Terminated
