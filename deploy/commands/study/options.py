"""What several verbs on studies are told."""

from typing import Annotated

import typer

from railctl.deploy.study.described import shipped_studies

StudyName = Annotated[
    str,
    typer.Argument(
        metavar="NAME",
        help=f"A study that is shipped ({', '.join(shipped_studies())}) or has been started, or a .yaml file.",
    ),
]
Cores = Annotated[int | None, typer.Option(help="Cores to use, a run on each; default: all.")]
OtherName = Annotated[str | None, typer.Option("--name", help="Name of its folder; default: the study's.")]
