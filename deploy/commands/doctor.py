"""railctl doctor: whether this machine can run what it should, and what to do if not."""

import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.status import Status
from rich.table import Table

from common.bus import NoAnswer, open_bus, open_router
from common.interpreter import run_module
from common.records.control import CommandAnswer, Empty
from common.task import FAILED
from common.wire.keys import Service
from deploy.launch import LOOPBACK, free_port
from deploy.output import AsJson, console, one_line_errors, say
from deploy.plan import ENVIRONMENT
from deploy.runs import Failed, runs_root

GIB = 2**30
NEEDED_MEMORY_GIB = 3.0
NEEDED_DISK_GIB = 1.0
ECHO = Service("doctor", Empty, CommandAnswer)


@one_line_errors
def doctor(as_json: AsJson = False) -> None:
    """Check this machine: Python, packages, cores, memory, disk, Zenoh, and arithmetic that repeats."""
    with Console(stderr=True).status("") as doing:  # nothing where there is no terminal
        rows = [_run(check, doing) for check in (_python, _packages, _cores, _memory, _disk, _zenoh, _arithmetic)]
    ok = all(row["ok"] for row in rows)
    if as_json:
        say("", {"ok": ok, "checks": rows}, as_json=True)
    else:
        table = Table("", "check", "found", box=None, pad_edge=False)
        for row in rows:
            table.add_row("ok" if row["ok"] else "!!", str(row["check"]), str(row["found"]))
        console.print(table)
    if not ok:
        sys.exit(FAILED)


def _run(check: Callable[[], str], doing: Status) -> dict[str, str | bool]:
    name = check.__name__.removeprefix("_")
    doing.update(f"checks {name}")
    try:
        return {"check": name, "ok": True, "found": check()}
    except Failed as error:
        return {"check": name, "ok": False, "found": str(error)}


def _python() -> str:
    if sys.version_info[:2] != (3, 11):
        raise Failed(f"{platform.python_version()}: install Python 3.11 and run make install")
    return platform.python_version()


def _packages() -> str:
    found = []
    for requirement in importlib.metadata.requires("railctl") or []:
        if "extra ==" in requirement:
            continue
        name = requirement.split("=")[0].split(">")[0].split("<")[0]
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            raise Failed(f"{name} is missing: run make install") from None
    return ", ".join(found)


def _cores() -> str:
    cores = len(os.sched_getaffinity(0))
    return f"{cores}" if cores > 1 else "1: runs work, on --cores 1"


def _memory() -> str:
    gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GIB
    if gib < NEEDED_MEMORY_GIB:
        raise Failed(f"{gib:.1f} GiB: a run with two actors wants {NEEDED_MEMORY_GIB:g}")
    return f"{gib:.1f} GiB"


def _disk() -> str:
    root = runs_root().absolute()
    existing = next(path for path in (root, *root.parents) if path.exists())
    if not os.access(existing, os.W_OK):
        raise Failed(f"{existing} is not writable: set RAILCTL_RUNS to a folder that is")
    gib = shutil.disk_usage(existing).free / GIB
    if gib < NEEDED_DISK_GIB:
        raise Failed(f"{gib:.1f} GiB free in {existing}: a run wants {NEEDED_DISK_GIB:g}")
    return f"{gib:.0f} GiB free in {existing}"


def _zenoh() -> str:
    endpoint = f"tcp/{LOOPBACK}:{free_port()}"
    try:
        with (
            open_router(endpoint),
            open_bus(endpoint, "doctor", 5.0) as here,
            open_bus(endpoint, "doctor", 5.0) as there,
        ):
            here.serve(ECHO, lambda question: question.answer(CommandAnswer(done=True, text="here")))
            there.ask(ECHO, Empty(), 5.0)
    except (OSError, NoAnswer) as error:
        raise Failed(f"no answer over {endpoint}: {error}: allow connections on {LOOPBACK}") from None
    return f"question and answer through a router on {LOOPBACK}"


def _arithmetic() -> str:
    """Two fresh processes must end in the same network, bit for bit."""
    with tempfile.TemporaryDirectory() as scratch:
        runs = [
            subprocess.run(
                run_module("services.learner.selfcheck"),
                capture_output=True,
                text=True,
                check=False,
                cwd=Path(scratch),
                env=os.environ | ENVIRONMENT,
            )
            for _ in range(2)
        ]
    for run in runs:
        if run.returncode:
            raise Failed(f"the learner does not run: {(run.stderr.splitlines() or ['no reason given'])[-1]}")
    if runs[0].stdout != runs[1].stdout:
        raise Failed("the same updates ended in two different networks: resumed runs will not be exact here")
    return f"repeats bit for bit ({runs[0].stdout.strip()[:12]})"
