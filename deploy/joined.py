"""Actors on other machines, as the supervisor of their run knows them: by their tokens and heartbeats. Pure."""

import time
from collections.abc import Collection

from railctl.common.levels.distributions import ANY
from railctl.common.records.control import ProcessStatus
from railctl.common.records.heartbeats import Heartbeat
from railctl.common.wire.keys import Alive

MOST = 1000  # that are shown


class Joined:
    """Who has joined and lives. Nothing but what is shown depends on it: others could pretend to be them."""

    def __init__(self, levels: Collection[str]) -> None:
        """`levels` are those of the run."""
        self._levels = sorted((*levels, ANY), key=len, reverse=True)
        self._alive: dict[str, str] = {}  # the incarnations of all actors by their names, those of this machine too
        self._heard: dict[str, ProcessStatus] = {}

    def on_alive(self, alive: Alive, there: bool) -> None:
        """A token came or went."""
        if alive.role != "actor":
            return
        if there and len(self._alive) < MOST:
            self._alive[alive.process] = alive.incarnation
        elif not there and self._alive.get(alive.process) == alive.incarnation:
            del self._alive[alive.process]
            self._heard.pop(alive.process, None)

    def on_beat(self, beat: Heartbeat) -> None:
        """A heartbeat of another machine came."""
        if beat.process in self._alive and beat.role == "actor":
            self._heard[beat.process] = ProcessStatus(
                process=beat.process,
                role=beat.role,
                serves=self._served_by(beat.process),
                pid=beat.pid,
                state=beat.state,
                restarts=0,  # only its own supervisor knows
                last_heartbeat_unix_s=round(time.time(), 3),
            )

    def statuses(self) -> list[ProcessStatus]:
        """Of all that have been heard."""
        return list(self._heard.values())

    def _served_by(self, process: str) -> str | None:
        """As `deploy.plan.actors` names them."""
        stem = process.rpartition("-")[0]
        return next((level for level in self._levels if stem.endswith(f"-{level}")), None)
