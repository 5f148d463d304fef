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
        """Make all calls that wait, the first of them after at most `wait_s`; None waits as long as it takes."""
        try:
            self._calls.get(block=wait_s != 0, timeout=wait_s)()
            while True:
                self._calls.get_nowait()()
        except queue.Empty:
            pass
