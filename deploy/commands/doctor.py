"""railctl doctor: whether this machine can run what it should, and what to do if not."""

import importlib.metadata
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from railctl.common.bus import Bus, NoAnswer, open_bus, open_router
from railctl.common.private import private_endpoint, remove_endpoint
from railctl.common.records.control import CommandAnswer, Empty
from railctl.common.task import FAILED
from railctl.common.wire.keys import Service
from railctl.deploy.output import AsJson, console, one_line_errors, say
from railctl.deploy.runs import Failed, runs_root
from railctl.deploy.task import run_task

GIB = 2**30
NEEDED_MEMORY_GIB = 3.0
NEEDED_DISK_GIB = 1.0
ANSWER_TIMEOUT_S = 5.0
COMPILERS = {
    "the world and what acts in it": "railctl.common.policy.compile",
    "what learns": "railctl.services.learner.compile",
    "the reference policies": "railctl.services.evaluator.references.compile",
}
ECHO = Service("doctor", Empty, CommandAnswer)


@one_line_errors
def doctor(
    compile_ahead: Annotated[
        bool, typer.Option("--compile", help="Before that, compile all that runs and evaluations need.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check this machine: Python, packages, cores, memory, disk, Zenoh, and arithmetic that repeats."""
    complaints = Console(stderr=True, highlight=False)
    if compile_ahead:
        for what, compiler in COMPILERS.items():
            complaints.print(f"compiles {what}, unless it is there")
            run_task(compiler)
    with complaints.status("") as doing:  # nothing where there is no terminal
        rows = [_run(check, doing.update) for check in (_python, _packages, _cores, _memory, _disk, _zenoh)]
    rows.append(_run(_arithmetic, lambda _text: None))  # it has progress of its own
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


def _run(check: Callable[[], str], tell: Callable[[str], None]) -> dict[str, str | bool]:
    name = check.__name__.removeprefix("_")
    tell(f"checks {name}")
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
    try:
        endpoint = private_endpoint()
    except OSError as error:
        raise Failed(f"no folder for a socket: {error.strerror}: set TMPDIR to one that you may write") from None
    try:
        with (
            open_router(endpoint),
            open_bus(endpoint, "doctor", 5.0) as here,
            open_bus(endpoint, "doctor", 5.0) as there,
        ):
            here.serve(ECHO, lambda question: question.answer(CommandAnswer(done=True, text="here")))
            _ask_until_answered(there, time.monotonic() + ANSWER_TIMEOUT_S)
    except (OSError, NoAnswer) as error:
        raise Failed(f"no answer over {endpoint}: {error}: set TMPDIR to a folder where sockets can be made") from None
    finally:
        remove_endpoint(endpoint)
    return "question and answer through a router on a socket of yours alone"


def _ask_until_answered(bus: Bus, deadline: float) -> None:
    """A question may overtake the word that there is somebody who answers it: the first one may find nobody."""
    while True:
        try:
            bus.ask(ECHO, Empty(), ANSWER_TIMEOUT_S)
        except NoAnswer:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.01)
        else:
            return


def _arithmetic() -> str:
    """Two fresh processes must end in the same network, bit for bit."""
    digests = [run_task("railctl.services.learner.selfcheck")["digest"] for _ in range(2)]
    if digests[0] != digests[1]:
        raise Failed("the same updates ended in two different networks: resumed runs will not be exact here")
    return f"repeats bit for bit ({digests[0][:12]})"
