"""railctl status: how far a run is, and how its processes are."""

import json

from railctl.common.bus import NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.records.control import Status
from railctl.deploy.events import last_events
from railctl.deploy.far import place_of, reach_far
from railctl.deploy.follow import live_status, status_from_files
from railctl.deploy.output import AsJson, Keys, RunOrAddress, console, line_width, one_line_errors, print_table
from railctl.deploy.runs import find_run, reach
from railctl.deploy.show import event_line, process_table, progress_line

SHOWN_EVENTS = 5


@one_line_errors
def status(run: RunOrAddress = None, keys: Keys = None, as_json: AsJson = False) -> None:
    """Show a run's progress, its processes (role, level, pid, state, restarts, last heartbeat) and last events."""
    place = place_of(run, keys, "reader", "operator")
    if place is None:
        folder = find_run(run)
        found, events = _near(folder), last_events(folder, SHOWN_EVENTS)
    else:
        with reach_far(*place) as (bus, _):
            found, events = live_status(bus), []  # they are written down where the run is
    if as_json:
        document = found.model_dump(mode="json") | {"events": [event.model_dump(mode="json") for event in events]}
        print(json.dumps(document, indent=2))
        return
    head, width = f"{found.run}: ", line_width()
    room = None if width is None else width - len(head)
    console.print(f"{head}{progress_line(found, room)}", markup=False, soft_wrap=True)
    if found.processes:
        print_table(process_table(found))
    for problem in found.problems:
        console.print(f"! {problem}", markup=False, soft_wrap=True)
    for event in events:
        console.print(event_line(event), markup=False, soft_wrap=True)


def _near(folder: RunFolder) -> Status:
    try:
        with reach(folder) as bus:
            return live_status(bus)
    except NoAnswer:
        return status_from_files(folder)
