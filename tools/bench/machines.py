"""Machines on this one: network namespaces, each with a link to us and none to another; making them needs root."""

import shutil
import subprocess
import uuid
from pathlib import Path
from typing import Self

IP = shutil.which("ip")
MOST_MACHINES = 16


class NoMachinesError(RuntimeError):
    """There cannot be any here; the text says why."""


class Machine:
    """A network namespace that lasts as long as the block that it is.

    Attributes:
        here, there: the addresses of the two ends of its link, of a range that is for benchmarks (RFC 2544).
        namespace: its name, for `ip netns exec`.
        link: the name of our end.
    """

    def __init__(self, number: int) -> None:
        """`number`, up to 255, tells the links that there are at a time."""
        mark = uuid.uuid4().hex[:8]  # names of links may have 15 characters
        self.namespace, self.link = f"railctl-{mark}", f"rail{mark}"
        self.here, self.there = f"198.18.{number}.1", f"198.18.{number}.2"

    def __enter__(self) -> Self:
        """Make it.

        Raises:
            NoMachinesError: the system refuses.
        """
        try:
            ip("netns", "add", self.namespace)
            ip("link", "add", self.link, "type", "veth", "peer", "name", "far", "netns", self.namespace)
            ip("addr", "add", f"{self.here}/30", "dev", self.link)
            ip("link", "set", self.link, "up")
            ip("-n", self.namespace, "addr", "add", f"{self.there}/30", "dev", "far")
            ip("-n", self.namespace, "link", "set", "far", "up")
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(self, *_exception: object) -> None:
        self._remove()

    def command(self, *command: str | Path) -> list[str | Path]:
        """What runs a command there."""
        return [str(IP), "netns", "exec", self.namespace, *command]

    def _remove(self) -> None:
        if IP is not None:
            for what in (("link", "del", self.link), ("netns", "del", self.namespace)):
                subprocess.run([IP, *what], check=False, capture_output=True)


def ip(*arguments: str) -> None:
    """Have the system's network changed; raises NoMachinesError if it refuses."""
    if IP is None:
        raise NoMachinesError("there is no ip command to make network namespaces with: install iproute2")
    done = subprocess.run([IP, *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        raise NoMachinesError(f"network namespaces cannot be made: {done.stderr.strip()}: try it as root")
