"""Tasks that pages wait for: one at a time, whatever so many tabs ask for, and what has come of them is kept."""

import asyncio
import gzip
import json
import tempfile
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from railctl.deploy.task import Task

MOST_WAITING = 8
MOST_KEPT_BYTES = 200_000_000
COMPRESSION = 4


class Busy(Exception):  # noqa: N818  (a state of things)
    """Too many wait already."""


class Tasks:
    """Carries out tasks that write a file, and keeps the files, compressed, by what they were asked for."""

    def __init__(self) -> None:
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._now: Task | None = None

    async def content(self, module: str, key: str, request: Callable[[Path], str]) -> bytes:
        """The file that a task writes, or else its result; compressed by gzip.

        Args:
            module: of the task.
            key: all that its outcome depends on.
            request: from a file that it may write, the task's argument.

        Raises:
            Busy: too many wait already.
            ConfigError, Failed: as `deploy.task.Task.result`.
        """
        if self._waiting >= MOST_WAITING:
            raise Busy
        self._waiting += 1
        try:
            async with self._turn:
                if key not in self._kept:
                    self._keep(key, await self._carry_out(module, request))
                self._kept.move_to_end(key)
                return self._kept[key]
        finally:
            self._waiting -= 1

    def end(self) -> None:
        """End what is being done."""
        if self._now is not None:
            self._now.end()

    async def _carry_out(self, module: str, request: Callable[[Path], str]) -> bytes:
        with tempfile.TemporaryDirectory(prefix="railctl-watch-") as folder:
            file = Path(folder) / "document.json"
            task = self._now = Task(module, request(file))
            try:
                await asyncio.to_thread(task.wait)
            except BaseException:
                task.end()
                raise
            finally:
                self._now = None
            result = await asyncio.to_thread(task.result)
            return await asyncio.to_thread(_compressed, file, result)

    def _keep(self, key: str, content: bytes) -> None:
        self._kept[key] = content
        while len(self._kept) > 1 and sum(map(len, self._kept.values())) > MOST_KEPT_BYTES:
            self._kept.popitem(last=False)


def _compressed(file: Path, result: Any) -> bytes:
    content = file.read_bytes() if file.exists() else json.dumps(result).encode()
    return gzip.compress(content, COMPRESSION)
