"""Carrying out a study: what the commands share."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from railctl.analysis.study import Study, StudyFolder, planned_runs
from railctl.common.folder import RunFolder
from railctl.common.levels.bank import bank_root
from railctl.common.locks import RunsAlreadyError, elsewhere, holder, living, sole
from railctl.common.process import Stopping
from railctl.common.strict import ConfigError
from railctl.deploy.runs import Failed, runs_root
from railctl.deploy.study.described import configurations
from railctl.deploy.study.dispatcher import Dispatcher, in_order
from railctl.deploy.study.estimate import measured, run_seconds
from railctl.deploy.study.levels import build_levels
from railctl.deploy.study.progress import Looking, command_of, commands
from railctl.deploy.study.runner import Runner
from railctl.deploy.study.shares import Share
from railctl.deploy.study.view import StudyView


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
def alone(folder: StudyFolder, share: Share | None = None) -> Iterator[None]:
    """Be the only command that works on a study, or on this share of it: only others of as many go on beside it.

    Raises:
        Failed: another one does.
    """
    folder.path.mkdir(parents=True, exist_ok=True)
    own = command_of(share)
    try:
        with sole(folder, own):
            others = {name: pid for name, pid in commands(folder).items() if name != own}
            if share is not None:
                others = {name: pid for name, pid in others.items() if not name.endswith(f"-of-{share.out_of}")}
            for pid in others.values():
                raise _works_already(folder, f"process {pid}")
            yield
    except RunsAlreadyError:
        host = elsewhere(folder)
        who = f"process {holder(folder, own)}" if host is None else f"a process on {host}"
        raise _works_already(folder, who) from None


def _works_already(folder: StudyFolder, who: str) -> Failed:
    name = folder.path.name
    return Failed(f"{who} works on study {name} already: railctl study status {name} shows it")


def carry_out(
    folder: StudyFolder, study: Study, cores: int, console: Console, share: Share | None = None
) -> tuple[Dispatcher, bool]:
    """Do all that is left to do of a study, its report included, or of a share of it, without.

    Returns:
        How far it came, and whether SIGTERM stopped it.
    """
    configs = configurations(study, cores)
    progress = Looking(folder, study).look()
    alive = {run for run in planned_runs(study) if living(RunFolder(folder.run(run)))}
    jobs = in_order(study, run_seconds(measured(folder, progress), study), alive)
    if share is not None:
        jobs = share.jobs(study, jobs)
    if progress.count("done", "trained") < len(progress.runs):
        build_levels(study, configs, bank_root(runs_root()), cores)
    with StudyView(folder, study, cores, console, None if share is None else share.runs(study)) as view:
        runner = Runner(folder, study, configs, jobs, bank_root(runs_root()), view)
        stopping = Stopping()
        runner.run(stopping)
    return runner.mind, stopping.terminated
