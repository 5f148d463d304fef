"""What a process that does one thing for the command line says to it (`deploy.task` listens).

On stdout JSON, a line each: `{"progress": {...}}` while the work goes on, then its result. What went wrong is the last
line on stderr, with exit code 1, or 2 if it was asked for what cannot be.
"""

import json
import logging
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from railctl.common.compile_signs import COMPILING, around_compiling
from railctl.common.room import NO_ROOM, without_room
from railctl.common.strict import ConfigError, brief

FAILED, WRONG_USAGE = 1, 2
TELL_EVERY_S = 0.1

log = logging.getLogger(__name__)


def say(document: dict[str, Any]) -> None:
    """Tell whoever started this process."""
    print(json.dumps(document), flush=True)  # noqa: T201  (they read it)


class Teller:
    """Says now and then how far the work on something is, and at the end in any case."""

    def __init__(self, of: str) -> None:
        self._of = of
        self._next = 0.0
        self._first: tuple[int, float] | None = None  # done, and when; what came before was mostly preparing

    def tell(self, done: int, total: int) -> None:
        """So many of so many are done."""
        now = time.monotonic()
        if self._first is None and done:
            self._first = done, now
        if now < self._next and done < total:
            return
        self._next = now + TELL_EVERY_S
        say({"progress": {"of": self._of, "done": done, "total": total, "seconds_left": self._left(done, total, now)}})

    def _left(self, done: int, total: int, now: float) -> float | None:
        if self._first is None or done == self._first[0]:
            return None
        first, since = self._first
        return (now - since) / (done - first) * (total - done)


class CompileTeller:
    """Says which function is being compiled, by number; how many there will be, nobody knows."""

    def __init__(self) -> None:
        self._done = 0

    @contextmanager
    def around(self, _function: str) -> Iterator[None]:
        """A function is being compiled."""
        self._done += 1
        say({"progress": {"of": COMPILING, "done": self._done, "total": None, "seconds_left": None}})
        yield


def carry_out(work: Callable[[], None], *failures: type[Exception]) -> None:
    """Do the work of this process; `failures` are the errors whose text is the whole story."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(message)s")
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _unwind)
    try:
        with around_compiling(CompileTeller().around):
            work()
    except ConfigError as error:
        _end(str(error), WRONG_USAGE)
    except failures as error:
        _end(str(error), FAILED)
    except OSError as error:
        if error.errno in NO_ROOM:
            _end(without_room(error), FAILED)
        where = f"{brief(str(error.filename), 200)}: " if error.filename else ""  # a write does not know
        _end(f"{where}{error.strerror}", FAILED)


def _unwind(_number: int, _frame: object) -> NoReturn:
    """Leave nothing half done behind; Ctrl-C sends one signal, the command that hears of it another."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _end(text: str, code: int) -> NoReturn:
    log.error("%s", text)
    sys.exit(code)
