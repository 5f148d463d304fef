"""railctl report: how reliably algorithms learn."""

from pathlib import Path
from typing import Annotated

import typer

from common.config import ConfigError, nearest
from deploy.judged import TITLES, judged_parts
from deploy.output import AsJson, console, one_line_errors, say
from deploy.task import run_task

JUDGE = "services.evaluator.reliability"
PROTOCOLS = ["default", "tool"]


@one_line_errors
def report(
    curves: Annotated[Path, typer.Option(metavar="FILE", help="Judge the learning curves of a .npz file.")],
    random_protocol: Annotated[
        str, typer.Option(help="default, or tool: resample exactly as the original tool does.")
    ] = PROTOCOLS[0],
    switch: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE", help="Another reading of the metrics (docs/reliability.md); may be repeated."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Rank algorithms by how reliably they learn, with 95% intervals and tests of all pairs."""
    report_curves(curves, random_protocol, switch or [], as_json=as_json)


def report_curves(curves: Path, random_protocol: str, switches: list[str], *, as_json: bool) -> None:
    """Judge a file of curves.

    Raises:
        ConfigError: the options are wrong.
        Failed: the file is.
    """
    if not curves.is_file():
        raise ConfigError(f"--curves {curves}: no such file")
    if random_protocol not in PROTOCOLS:
        raise ConfigError(f"--random-protocol {random_protocol!r}{nearest(random_protocol, PROTOCOLS)}")
    document = run_task(
        JUDGE,
        str(curves),
        f"--random-protocol={random_protocol}",
        *(f"--switch={switch}" for switch in switches),
        *([] if as_json else [f"--key={key}" for key in TITLES]),
    )
    shape = document["shape"]
    sizes = " x ".join(f"{shape[name]} {name}" for name in ("algorithms", "tasks", "runs", "episodes"))
    say(f"{curves}: {', '.join([sizes.replace('tasks', 'levels'), *switches])}\n", document, as_json=as_json)
    if not as_json:
        for part in judged_parts(document):
            console.print(part, markup=False, soft_wrap=isinstance(part, str))
