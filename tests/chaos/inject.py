"""Carries out faults on a run of this machine."""

import os
import random
import resource
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from faults import Fault
from hanging import hung
from strangers import Stranger

from railctl.common.bus import NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.locks import living
from railctl.common.records.control import ScaleRequest
from railctl.common.wire import keys
from railctl.deploy.runs import reach

SUSPENSIONS = {"suspended 1 s": 1.0, "suspended 6 s": 6.0, "suspended 40 s": 40.0}
SHORT_OF = 2_000_000  # bytes that a process gets before its memory ends
ASK_S = 10.0
LOOK_S = 0.1


def inject(fault: Fault, run: RunFolder, stranger: Stranger, hang_timeout_s: float) -> str:
    """Do it; returns what it was done to."""
    rng = random.Random(fault.choice)
    if not fault.target:
        MESSAGES[fault.kind](run, stranger, rng)
        return "everybody"
    pid, name = _process(run, fault.target, rng)
    if pid is None:
        return "nobody: it was not there"
    with suppress(ProcessLookupError):
        match fault.kind:
            case "killed":
                os.kill(pid, signal.SIGKILL)
            case "killed with another":
                for one in {pid, rng.choice(list(living(run).values()))}:
                    os.kill(one, signal.SIGKILL)
            case "hung":
                with hung(pid):
                    _sleep_while_alive(pid, 3 * hang_timeout_s)
            case "disk full":
                resource.prlimit(pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
            case "memory short":
                resource.prlimit(pid, resource.RLIMIT_AS, (_size(pid) + SHORT_OF, resource.RLIM_INFINITY))
            case "newest snapshot damaged":
                _damage(run, rng)
                os.kill(pid, signal.SIGKILL)
            case _:
                os.kill(pid, signal.SIGSTOP)
                _sleep_while_alive(pid, SUSPENSIONS[fault.kind])
                os.kill(pid, signal.SIGCONT)
    return name


def _process(run: RunFolder, role: str, rng: random.Random) -> tuple[int | None, str]:
    there = {name: pid for name, pid in living(run).items() if name.startswith(role)}
    if not there:
        return None, role
    name = rng.choice(sorted(there))
    return there[name], name


def _sleep_while_alive(pid: int, seconds: float) -> None:
    """A process that does not answer for long is killed by its supervisor."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and _state(pid) not in ("", "Z"):
        time.sleep(LOOK_S)


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return ""


def _size(pid: int) -> int:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def _damage(run: RunFolder, rng: random.Random) -> None:
    """Cut or flip the newest snapshot, if there is one before it."""
    paths = sorted(run.snapshots.glob("*.safetensors"))
    if len(paths) < 2:
        return
    with suppress(FileNotFoundError):  # the learner has just replaced it
        content = bytearray(paths[-1].read_bytes())
        at = rng.randrange(len(content))
        if rng.random() < 0.5:
            del content[at:]
        else:
            content[at] ^= 1 << rng.randrange(8)
        paths[-1].write_bytes(content)


def _scale(run: RunFolder, _stranger: Stranger, rng: random.Random) -> None:
    with suppress(NoAnswer), reach(run) as bus:
        bus.ask(keys.SCALE, ScaleRequest(actors={"easy": rng.randrange(1, 5)}), ASK_S)


MESSAGES: dict[str, Callable[[RunFolder, Stranger, random.Random], None]] = {
    "garbage": lambda _run, stranger, rng: stranger.garbage(rng),
    "truncated message": lambda _run, stranger, rng: stranger.truncated(rng),
    "message twice": lambda _run, stranger, _rng: stranger.twice(),
    "message replayed": lambda _run, stranger, _rng: stranger.replayed(),
    "message of another schema": lambda _run, stranger, rng: stranger.of_another_schema(rng),
    "message of another run": lambda _run, stranger, rng: stranger.of_another_run(rng),
    "forged fragment": lambda _run, stranger, rng: stranger.forged(rng),
    "forged heartbeat": lambda _run, stranger, rng: stranger.forged_heartbeat(rng),
    "lease taken by a stranger": lambda _run, stranger, _rng: stranger.takes_a_lease(),
    "oversize message": lambda _run, stranger, _rng: stranger.oversize(),
    "actors scaled": _scale,
}
