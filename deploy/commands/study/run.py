"""railctl study run: carry out a study, or go on with one."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.analysis.report import archive
from railctl.analysis.study import Study, StudyFolder
from railctl.common.folder import write_atomically
from railctl.common.strict import ConfigError
from railctl.deploy.commands.study.options import Cores, OtherName, StudyName
from railctl.deploy.output import console, one_line_errors, print_table
from railctl.deploy.runs import Failed, runs_root
from railctl.deploy.study.described import configurations, find_study, named, save_study
from railctl.deploy.study.progress import Looking, report_of
from railctl.deploy.study.shares import parse_share
from railctl.deploy.study.view import cell_table, headline
from railctl.deploy.study.work import alone, carry_out, cores_of


@one_line_errors
def run(
    name: StudyName,
    cores: Cores = None,
    other_name: OtherName = None,
    results: Annotated[
        Path | None, typer.Option("--from", help="Results of railctl study publish: what is in them is not done again.")
    ] = None,
    share: Annotated[
        str | None, typer.Option(metavar="I/N", help="Only this share of the runs, as 2/8, beside the other ones.")
    ] = None,
) -> None:
    """Train, evaluate and report on all that a study compares; killed or stopped at any time, it goes on from there."""
    used = cores_of(cores)
    study = named(find_study(name), other_name)
    configurations(study, used)
    folder = StudyFolder(runs_root() / study.name)
    own = None if share is None else parse_share(share, study)
    options = (f" --name {other_name}" if other_name else "") + (f" --share {own}" if own else "")
    goes_on = f"railctl study run {name}{options} goes on"
    archived = None if results is None else _archived(results, study, folder)
    save_study(folder, study)
    if archived is not None:
        write_atomically(folder.results, archived)
    with alone(folder, own):
        try:
            mind, terminated = carry_out(folder, study, used, console, own)
        except KeyboardInterrupt:
            console.print(f"stopped; {goes_on}", markup=False, soft_wrap=True)
            return
        except BrokenPipeError:
            raise Failed(f"nobody reads this any more; {goes_on}") from None
    progress = Looking(folder, study).look()
    print_table(cell_table(progress))
    console.print(f"{study.name}: {headline(progress, None)}", markup=False, soft_wrap=True)
    console.print(f"study    {folder.path}", markup=False, soft_wrap=True)
    if own is not None and not mind.stopping:
        told = f"share {own} is done; once all are, railctl study report {study.name} makes the report"
        console.print(told, markup=False, soft_wrap=True)
    elif (report := report_of(folder)) is not None and not mind.stopping:
        console.print(f"report   {report}", markup=False, soft_wrap=True)
    if mind.failures:
        for job, reason in mind.failures.items():
            console.print(f"! {job.name}: {reason}", markup=False, soft_wrap=True)
        raise Failed(f"{len(mind.failures)} of study {study.name} failed: {goes_on.replace('goes on', 'tries again')}")
    if terminated:  # whoever sent it shall not take the study for done
        raise Failed(f"SIGTERM: stopped; {goes_on}")
    if mind.stopping:
        console.print(f"stopped; {goes_on}", markup=False, soft_wrap=True)


def _archived(path: Path, study: Study, folder: StudyFolder) -> bytes:
    """The content of a file of results, or of that in a folder.

    Raises:
        ConfigError: it cannot be read, is of another study, or has less than the study was begun from.
    """
    path = StudyFolder(path).results if path.is_dir() else path
    theirs = archive.load(path)
    if theirs.study.model_copy(update={"name": study.name}) != study:
        raise ConfigError(f"--from {path}: these are results of another study ({theirs.study.name}): leave it out")
    if folder.results.exists() and not archive.load(folder.results).done <= theirs.done:
        raise ConfigError(f"--from {path}: lacks runs that are in {folder.results}: leave it out to go on from those")
    return path.read_bytes()
