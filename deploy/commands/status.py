"""railctl status: how far a run is, and how its processes are."""

from common.bus import NoAnswer
from common.records.control import Status
from deploy.far import place_of, reach_far
from deploy.follow import live_status, status_from_files
from deploy.output import AsJson, Keys, RunOrAddress, console, one_line_errors, print_table
from deploy.runs import find_run, reach
from deploy.show import process_table, progress_line


@one_line_errors
def status(run: RunOrAddress = None, keys: Keys = None, as_json: AsJson = False) -> None:
    """Show a run's progress and every process: role, level, pid, state, restarts, last heartbeat."""
    place = place_of(run, keys, "reader", "operator")
    if place is None:
        found = _near(run)
    else:
        with reach_far(*place) as (bus, _):
            found = live_status(bus)
    if as_json:
        print(found.model_dump_json(indent=2))
        return
    console.print(f"{found.run}: {progress_line(found)}", markup=False, soft_wrap=True)
    if found.processes:
        print_table(process_table(found))
    for problem in found.problems:
        console.print(f"! {problem}", markup=False, soft_wrap=True)


def _near(run: str | None) -> Status:
    folder = find_run(run)
    try:
        with reach(folder) as bus:
            return live_status(bus)
    except NoAnswer:
        return status_from_files(folder)
