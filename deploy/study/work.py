"""Carrying out a study: what the commands share."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console

from analysis.study import Study, StudyFolder, planned_runs
from common.folder import RunFolder
from common.levels.bank import bank_root
from common.locks import RunsAlreadyError, holder, living, sole
from common.process import Stopping
from common.strict import ConfigError
from deploy.runs import Failed, runs_root
from deploy.study.described import configurations
from deploy.study.dispatcher import Dispatcher, Job, in_order
from deploy.study.estimate import measured, run_seconds
from deploy.study.levels import build_levels
from deploy.study.progress import COMMAND, Looking
from deploy.study.runner import Runner
from deploy.study.view import StudyView


def cores_of(asked: int | None) -> int:
    """The cores to use, all of them if none are asked for.

    Raises:
        ConfigError: there are not so many.
    """
    there = len(os.sched_getaffinity(0))
    if asked is not None and not 1 <= asked <= there:
        raise ConfigError(f"--cores {asked}: this machine offers {there}, use 1 to {there}")
    return asked or there


@contextmanager
def alone(folder: StudyFolder) -> Iterator[None]:
    """Be the only command that works in a study's folder.

    Raises:
        Failed: another one does.
    """
    folder.path.mkdir(parents=True, exist_ok=True)
    try:
        with sole(folder, COMMAND):
            yield
    except RunsAlreadyError:
        name, pid = folder.path.name, holder(folder, COMMAND)
        raise Failed(f"process {pid} works on study {name} already: railctl study status {name} shows it") from None


def carry_out(folder: StudyFolder, study: Study, cores: int, console: Console) -> Dispatcher:
    """Do all that is left to do of a study, its report included."""
    configs = configurations(study, cores)
    progress = Looking(folder, study).look()
    alive = {run for run in planned_runs(study) if living(RunFolder(folder.run(run)))}
    jobs = in_order(study, run_seconds(measured(folder, progress), study), alive)
    if progress.count("done", "trained") < len(progress.runs):
        build_levels(study, configs, bank_root(runs_root()), cores)
    return _run(folder, study, cores, jobs, console)


def _run(folder: StudyFolder, study: Study, cores: int, jobs: Sequence[Job], console: Console) -> Dispatcher:
    with StudyView(folder, study, cores, console) as view:
        runner = Runner(folder, study, configurations(study, cores), jobs, bank_root(runs_root()), view)
        runner.run(Stopping())
    return runner.mind
