"""Runs for `tools.bench.cluster`, as a user starts them: on one machine, or with actors on others."""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from railctl.common.folder import RunFolder
from railctl.tools.bench.machines import Machine
from railctl.tools.bench.measuring import DisagreementError

RAILCTL = Path(sys.executable).with_name("railctl")
NAME = "bench"
JOIN_PATIENCE_S = 120
LOOK_S = 0.5


class Case(NamedTuple):
    """A run to be measured.

    Attributes:
        actors: on the learner's machine, or on the others, if there are any, as evenly as can be.
        machines: beside the learner's.
    """

    algorithm: str
    level: str
    lag: str
    actors: int
    machines: int = 0

    @property
    def name(self) -> str:
        """What tells it from others."""
        where = f" on {self.machines} machine{'s' * (self.machines > 1)}" if self.machines else ""
        return f"{self.algorithm} {self.level} lag {self.lag}, actors {self.actors}{where}"

    def actors_of(self, machine: int) -> int:
        """How many the machine of this number has, from 0."""
        return self.actors // self.machines + (machine < self.actors % self.machines)


class Joined(NamedTuple):
    """A process that has a machine's actors, and the file with all that it says."""

    process: subprocess.Popen[bytes]
    log: Path

    @property
    def last_words(self) -> str:
        return (self.log.read_text().splitlines() or ["it said nothing"])[-1]


def play(case: Case, episodes: int, folder: str) -> None:
    """Have the run played from nothing to its end, in this folder of runs.

    Raises:
        DisagreementError: it failed.
        NoMachinesError: the system lets nobody make any.
    """
    here = 0 if case.machines else case.actors
    options = [
        *("--algorithm", case.algorithm, "--level", case.level, "--lag", case.lag),
        *("--actors", f"{case.level}={here}", "--episodes", str(episodes), "--seed", "1", "--name", NAME),
    ]
    with ended_with_us(folder), ExitStack() as stack:
        if case.machines:
            machines = [stack.enter_context(Machine(number + 1)) for number in range(case.machines)]
            keys, port = f"{folder}/keys", _free_port()
            railctl(folder, "keys", "create", keys, *(f"--host={machine.here}" for machine in machines))
            railctl(folder, "up", "--detach", *options, "--listen", f"tls/0.0.0.0:{port}", "--keys", keys)
            RunFolder(Path(folder) / NAME).paused_file.touch()  # its learner, which takes seconds to start, waits
            joined = [
                stack.enter_context(_joined(case, number, machine, port, folder))
                for number, machine in enumerate(machines)
            ]
            _wait_for_actors(case, folder, joined)
            railctl(folder, "resume", NAME)
            options = ["--name", NAME]
        railctl(folder, "up", *options)


@contextmanager
def ended_with_us(folder: str) -> Iterator[None]:
    """Whatever ends the block before its time ends the run, too."""
    try:
        yield
    except BaseException:
        subprocess.run((RAILCTL, "down", NAME, "--force"), env=_environment(folder), capture_output=True, check=False)
        raise


def railctl(folder: str, *arguments: str) -> str:
    """Run a command to its end; returns what it printed. Raises as `play`."""
    done = subprocess.run((RAILCTL, *arguments), env=_environment(folder), capture_output=True, text=True, check=False)
    if done.returncode:
        raise DisagreementError(f"the run failed: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


@contextmanager
def _joined(case: Case, number: int, machine: Machine, port: int, folder: str) -> Iterator[Joined]:
    """A machine's actors, until the run is trained or the block ends."""
    log = Path(folder) / f"{machine.namespace}.log"
    actors = f"{case.level}={case.actors_of(number)}"
    join = (RAILCTL, "join", f"tls/{machine.here}:{port}", "--keys", f"{folder}/keys", "--actors", actors)
    with (
        log.open("w") as output,
        subprocess.Popen(
            machine.command(*join, "--wait", str(JOIN_PATIENCE_S)),
            env=_environment(folder) | {"TMPDIR": folder},  # where it keeps what it would leave behind if it is killed
            stdout=output,
            stderr=output,
        ) as process,
    ):
        try:
            yield Joined(process, log)
        except BaseException:
            process.kill()  # its actors end with it
            raise


def _wait_for_actors(case: Case, folder: str, joined: Sequence[Joined]) -> None:
    """Return when the actors of all machines can act; raises as `play`, also if that takes too long."""
    deadline = time.monotonic() + JOIN_PATIENCE_S
    while time.monotonic() < deadline:
        status = json.loads(railctl(folder, "status", NAME, "--json"))
        acting = [one for one in status["processes"] if one["role"] == "actor" and one["state"] != "starting"]
        if len(acting) == case.actors and status["state"] == "paused":
            return
        for machine in joined:
            if machine.process.poll() is not None:
                raise DisagreementError(f"{case.name}: {machine.last_words}")
        time.sleep(LOOK_S)
    said = "; ".join(machine.last_words for machine in joined)
    raise DisagreementError(f"{case.name}: not all actors came within {JOIN_PATIENCE_S} s: {said}")


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
        return port


def _environment(folder: str) -> dict[str, str]:
    """No bank of levels of the user's is used."""
    return os.environ | {"RAILCTL_RUNS": folder, "RAILCTL_LEVELS": f"{folder}/.levels"}
