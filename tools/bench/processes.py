"""What the processes of a run cost: processor time and memory, read from `/proc` while they live."""

import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Self

EVERY_S = 0.2
TICKS = os.sysconf("SC_CLK_TCK")


class Watch:
    """Watches all processes whose environments name a folder, in the block that it is.

    Attributes:
        cpu_s: processor seconds of all of them, as of their last look.
        peak_bytes: the most that all of them held at a time; pages that processes share count once (PSS).
    """

    def __init__(self, folder: str) -> None:
        self._folder = folder.encode()
        self._seconds: dict[int, float] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look_on, name="watch", daemon=True)
        self.peak_bytes = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._ended.set()
        self._thread.join()

    @property
    def cpu_s(self) -> float:
        return sum(self._seconds.values())

    def _look_on(self) -> None:
        while not self._ended.wait(EVERY_S):
            held = 0
            for pid in self._pids():
                try:
                    self._seconds[pid] = _cpu_s(pid)
                    held += _pss_bytes(pid)
                except (OSError, ValueError):  # it has ended
                    continue
            self.peak_bytes = max(self.peak_bytes, held)

    def _pids(self) -> Iterator[int]:
        for path in Path("/proc").glob("[0-9]*"):
            pid = int(path.name)
            try:
                named = self._folder in (path / "environ").read_bytes()
            except OSError:  # it has ended, or is somebody else's
                continue
            if named and pid != os.getpid():
                yield pid


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS  # in user mode and in the kernel


def _pss_bytes(pid: int) -> int:
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024
    raise ValueError(f"process {pid} has no Pss")
