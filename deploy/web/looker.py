"""A thread that looks after one thing for all tabs that show it, and keeps what they are sent."""

import json
import threading
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

from railctl.deploy.web.listeners import Listeners

AGAIN_S = 1.0  # after something that nobody foresaw


class Part(NamedTuple):
    """A part of what is shown, as it goes over the wire; the version tells whether it is news."""

    version: int
    body: str


class Looker(ABC):
    """Runs `look` on a thread of its own, from the first listener until some time after the last one."""

    kind: str  # of what is looked at: run or study

    def __init__(self, name: str) -> None:
        self.name = name
        self.listeners = Listeners()
        self.parts: dict[str, Part] = {}  # replaced, never changed
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"watch {name}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        """Have the thread end soon."""
        self._ended.set()

    def join(self, timeout_s: float) -> None:
        self._thread.join(timeout_s)

    @property
    def ended(self) -> bool:
        return self._ended.is_set()

    def pause(self, seconds: float) -> bool:
        """Wait; whether to go on."""
        return not self._ended.wait(seconds)

    def tell(self, part: str, document: dict[str, Any]) -> None:
        """Make a part news, if it is any."""
        body = json.dumps(document, separators=(",", ":"), allow_nan=False)
        before = self.parts.get(part)
        if before is None or before.body != body:
            self.parts = self.parts | {part: Part(1 if before is None else before.version + 1, body)}
            self.listeners.wake()

    def _work(self) -> None:
        while not self.ended:
            try:
                self.look()
            except Exception as error:  # noqa: BLE001  (or it would say "loading" for ever)
                self.tell(self.kind, {"name": self.name, "wrong": f"cannot be shown: {type(error).__name__}: {error}"})
                self.pause(AGAIN_S)

    @abstractmethod
    def look(self) -> None:
        """Look for a while, and `tell`; must return soon once `ended`."""
