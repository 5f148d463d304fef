"""railctl down: stop a run cleanly; `railctl up` goes on with it."""

import os
import signal
from contextlib import suppress
from typing import Annotated

import typer

from railctl.common.bus import NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.locks import holder, living
from railctl.common.records.control import Empty
from railctl.common.wire.keys import STOP
from railctl.deploy.far import Place, place_of, reach_far
from railctl.deploy.follow import wait_until
from railctl.deploy.output import AsJson, Keys, RunOrAddress, one_line_errors, say
from railctl.deploy.runs import Failed, check_here, find_run, reach, supervised
from railctl.deploy.supervisor import STAGES

ASK_TIMEOUT_S = 3.0
PATIENCE_S = 75.0
FORCED_PATIENCE_S = 5.0


@one_line_errors
def down(
    run: RunOrAddress = None,
    keys: Keys = None,
    force: Annotated[bool, typer.Option("--force", help="Do not wait for clean ends.")] = False,
    as_json: AsJson = False,
) -> None:
    """Stop every process of a run; the learner writes a snapshot first, so that nothing is lost."""
    place = place_of(run, keys, "operator")
    if place is not None:
        text = stop_far(place, force=force)
        say(text, {"done": True, "text": text}, as_json=as_json)
        return
    folder = find_run(run)
    check_here(folder)
    if not living(folder):
        say(f"run {folder.path.name} is not running", {"done": True, "text": "not running"}, as_json=as_json)
        return
    if supervised(folder):
        ask_to_stop(folder)
        if force:
            ask_to_stop(folder)
        if not wait_until(lambda: not supervised(folder), PATIENCE_S):
            raise Failed(f"run {folder.path.name} does not stop: railctl down --force {folder.path.name}")
    _end_the_rest(folder, force=force)
    text = f"run {folder.path.name} is down; railctl up --name {folder.path.name} goes on"
    say(text, {"done": True, "text": text}, as_json=as_json)


def ask_to_stop(folder: RunFolder) -> None:
    """Ask the supervisor for a clean stop, without waiting for it; the second time for a forced one."""
    try:
        with reach(folder) as bus:
            bus.ask(STOP, Empty(), ASK_TIMEOUT_S)
    except NoAnswer:  # its router is away
        if pid := holder(folder, "supervisor"):
            os.kill(pid, signal.SIGTERM)


def stop_far(place: Place, *, force: bool) -> str:
    """Have a run on another machine stop; returns what is to be said of it.

    Raises:
        NoAnswer: it is not there.
        Failed: it does not stop.
    """
    with reach_far(*place) as (bus, run):
        bus.ask(STOP, Empty(), ASK_TIMEOUT_S)
        if force:
            with suppress(NoAnswer):  # it has ended meanwhile
                bus.ask(STOP, Empty(), ASK_TIMEOUT_S)
        if not wait_until(lambda: not bus.connected(), PATIENCE_S):
            raise Failed(
                f"run {run.name} does not stop: railctl down {place.address} --keys {place.credentials.folder} --force"
            )
    return f"run {run.name} stops, and its link has ended; railctl up --name {run.name} goes on, on its machine"


def _end_the_rest(folder: RunFolder, *, force: bool) -> None:
    """End what a killed supervisor left behind, in the supervisor's order."""
    for roles in STAGES:
        for number, patience_s in ((signal.SIGTERM, PATIENCE_S / 3), (signal.SIGKILL, FORCED_PATIENCE_S)):
            if force and number == signal.SIGTERM:
                continue
            for pid in _of(folder, roles).values():
                os.kill(pid, number)
            if wait_until(lambda roles=roles: not _of(folder, roles), patience_s):  # type: ignore[misc]
                break


def _of(folder: RunFolder, roles: tuple[str, ...]) -> dict[str, int]:
    return {name: pid for name, pid in living(folder).items() if name.partition("-")[0] in roles}
