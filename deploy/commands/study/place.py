"""railctl study place: a batch script for a study on many nodes."""

from typing import Annotated

import typer

from railctl.deploy.backends.slurm import study_script
from railctl.deploy.commands.study.options import OtherName, StudyName
from railctl.deploy.output import one_line_errors
from railctl.deploy.placement import placed_study
from railctl.deploy.runs import runs_root
from railctl.deploy.study.described import find_study, named


@one_line_errors
def place(
    name: StudyName,
    shares: Annotated[int, typer.Option(metavar="N", help="Jobs that do its runs between them.")],
    cores: Annotated[int, typer.Option(min=1, help="Cores of each job, a run on each; default: 2.")] = 2,
    other_name: OtherName = None,
) -> None:
    """Print a batch script that has Slurm carry out a study, as an array of jobs with a share of its runs each."""
    placement = placed_study(named(find_study(name), other_name), name, shares, cores)
    print(study_script(placement, runs_root().absolute()), end="")
