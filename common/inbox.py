"""Messages that arrive on any thread and are handled on one."""

import queue
from collections.abc import Callable
from functools import partial
from typing import Any


class Inbox:
    """What a loop still has to do."""

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()

    def into(self, handle: Callable[..., None]) -> Callable[..., None]:
        """A callback for any thread; its calls wait here until `take` makes them."""

        def put(*arguments: Any) -> None:
            self._calls.put(partial(handle, *arguments))

        return put

    def take(self, wait_s: float = 0.0) -> None:
        """Make all calls that wait, the first of them after at most `wait_s`."""
        try:
            self._calls.get(timeout=wait_s)() if wait_s else self._calls.get_nowait()()
            while True:
                self._calls.get_nowait()()
        except queue.Empty:
            pass
