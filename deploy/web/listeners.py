"""What a thread knows, told to those who listen on an event loop: they are woken, and take the newest."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Listeners:
    """Those who wait for news; several pieces of news may wake them once."""

    def __init__(self) -> None:
        self._lock = threading.RLock()  # the handler of a signal may wake, too
        self._waiting: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    @contextmanager
    def listening(self, event: asyncio.Event) -> Iterator[None]:
        """Have the event set whenever there are news."""
        entry = (asyncio.get_running_loop(), event)
        with self._lock:
            self._waiting.add(entry)
        try:
            yield
        finally:
            with self._lock:
                self._waiting.discard(entry)

    def wake(self) -> None:
        """There are news."""
        with self._lock:
            for loop, event in self._waiting:
                if not loop.is_closed():
                    loop.call_soon_threadsafe(event.set)


class Ending(Listeners):
    """The end of a server, which those who listen look for when they are woken."""

    over = False

    def begin(self) -> None:
        """It has come."""
        self.over = True
        self.wake()
