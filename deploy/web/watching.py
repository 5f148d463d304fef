"""The threads that look after what is watched: one each, however many tabs show it, and none for what nobody shows."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from railctl.deploy.web.catalogue import Catalogue
from railctl.deploy.web.looker import Looker
from railctl.deploy.web.watched_run import WatchedRun
from railctl.deploy.web.watched_study import WatchedStudy

MOST = 40  # that are looked after at once
GRACE_S = 30.0  # a tab that is loaded again finds what it left
END_S = 2.0


class TooMany(Exception):  # noqa: N818  (a state of things)
    """More are shown already than this server looks after."""


class Watching:
    """Starts and ends lookers."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._lock = threading.Lock()
        self._lookers: dict[tuple[str, str], Looker] = {}
        self._shown: dict[tuple[str, str], int] = {}
        self._ending: set[tuple[str, str]] = set()  # that a timer looks at again

    @contextmanager
    def shown(self, kind: str, name: str) -> Iterator[Looker]:
        """Have somebody look after a run or study for as long as the block lasts, and a while longer.

        Raises:
            ConfigError: there is none of this name.
            TooMany: too many are looked after.
        """
        looker = self._taken(kind, name)
        try:
            yield looker
        finally:
            with self._lock:
                self._shown[kind, name] -= 1
                ends = not self._shown[kind, name] and (kind, name) not in self._ending
                if ends:
                    self._ending.add((kind, name))
            if ends:
                timer = threading.Timer(GRACE_S, self._end_unshown, (kind, name))
                timer.daemon = True
                timer.start()

    def end(self) -> None:
        """End all of them."""
        with self._lock:
            lookers = list(self._lookers.values())
            self._lookers.clear()
        for looker in lookers:
            looker.end()
        for looker in lookers:
            looker.join(END_S)

    def _taken(self, kind: str, name: str) -> Looker:
        with self._lock:
            looker = self._lookers.get((kind, name))
            if looker is None:
                if len(self._lookers) >= MOST:
                    raise TooMany
                looker = self._made(kind, name)
                self._lookers[kind, name] = looker
                looker.start()
            self._shown[kind, name] = self._shown.get((kind, name), 0) + 1
            return looker

    def _made(self, kind: str, name: str) -> Looker:
        if kind == "study":
            return WatchedStudy(name, self._catalogue.study(name))
        return WatchedRun(name, self._catalogue.run(name))

    def _end_unshown(self, kind: str, name: str) -> None:
        with self._lock:
            self._ending.discard((kind, name))
            if self._shown.get((kind, name), 0) > 0:
                return
            self._shown.pop((kind, name), None)
            looker = self._lookers.pop((kind, name), None)
        if looker is not None:
            looker.end()
