"""Messages that arrive on any thread and are handled on one."""

import queue
from collections.abc import Callable


class Inbox:
    """What a loop still has to do."""

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()

    def put(self, call: Callable[[], object]) -> None:
        """From any thread: have a call wait here until `take` makes it."""
        self._calls.put(call)

    def take(self, wait_s: float | None = 0.0) -> None:
        """Make all calls that wait, the first of them after at most `wait_s`; None waits as long as it takes.

        Those that come meanwhile wait for the next time: whoever takes has other things to do, however many come.
        """
        try:
            call = self._calls.get(block=wait_s != 0, timeout=wait_s)
        except queue.Empty:
            return
        others = self._calls.qsize()
        call()
        for _ in range(others):
            self._calls.get()()
