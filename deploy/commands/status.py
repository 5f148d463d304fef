"""railctl status: how far a run is, and how its processes are."""

from common.bus import NoAnswer
from deploy.follow import live_status, status_from_files
from deploy.output import AsJson, RunName, console, one_line_errors, print_table
from deploy.runs import find_run, reach
from deploy.show import process_table, progress_line


@one_line_errors
def status(run: RunName = None, as_json: AsJson = False) -> None:
    """Show a run's progress and every process: role, level, pid, state, restarts, last heartbeat."""
    folder = find_run(run)
    try:
        with reach(folder) as bus:
            found = live_status(bus)
    except NoAnswer:
        found = status_from_files(folder)
    if as_json:
        print(found.model_dump_json(indent=2))
        return
    console.print(f"{found.run}: {progress_line(found)}", markup=False, soft_wrap=True)
    if found.processes:
        print_table(process_table(found))
    for problem in found.problems:
        console.print(f"! {problem}", markup=False, soft_wrap=True)
