"""railctl study status: how far a study is, from its folder alone."""

import json

from railctl.analysis.study import StudyFolder, read_study
from railctl.common.folder import RunFolder
from railctl.deploy.commands.study.options import StudyName
from railctl.deploy.output import AsJson, console, one_line_errors, print_table
from railctl.deploy.study.described import find_folder
from railctl.deploy.study.estimate import measured, seconds_left
from railctl.deploy.study.progress import Looking, StudyProgress, commands, status_document
from railctl.deploy.study.view import cell_table, headline
from railctl.deploy.study.work import cores_of


@one_line_errors
def status(name: StudyName, as_json: AsJson = False) -> None:
    """Show how many runs of each contender on each level are done, running, waiting or failed, and the time left."""
    folder = find_folder(name)
    study = read_study(folder.study_file)
    progress = Looking(folder, study).look()
    left = seconds_left(progress, measured(folder, progress), _cores(folder, progress))
    if as_json:
        print(json.dumps(status_document(folder, progress, left), indent=2))
        return
    pids = list(commands(folder).values())
    going = f" (process {', '.join(map(str, pids))})" if pids else ""
    console.print(f"{study.name}{going}: {headline(progress, left)}", markup=False, soft_wrap=True)
    print_table(cell_table(progress))
    if progress.references:
        console.print(f"references: {sum(progress.references.values())} of {len(progress.references)} scored")
    for run, reason in progress.failures.items():
        console.print(f"! {run}: {reason}", markup=False, soft_wrap=True)
    if not pids and not progress.is_done:
        console.print(f"nobody works on it: railctl study run {study.name} goes on", markup=False, soft_wrap=True)


def _cores(folder: StudyFolder, progress: StudyProgress) -> int:
    """Those that the command uses which works on the study, or else all."""
    running = [run.run for run in progress.runs if run.state == "running"]
    return RunFolder(folder.run(running[0])).config().cluster.cores if running else cores_of(None)
