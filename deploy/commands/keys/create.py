"""railctl keys create: make the keys by which the machines of a run know each other."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.deploy.certificates import create, this_host
from railctl.deploy.output import AsJson, one_line_errors, say
from railctl.deploy.runs import runs_root


@one_line_errors
def create_keys(
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="A new folder; default: keys, beside the runs.")
    ] = None,
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            help="Name or address by which others reach the run's machine; may be repeated; default: its own name.",
        ),
    ] = None,
    relays: Annotated[
        list[str] | None,
        typer.Option("--relay", help="Name or address of a machine that shall relay; may be repeated; default: none."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make an authority and a certificate for each role: host, actor, reader, operator, maybe relay."""
    folder = folder or runs_root().absolute().parent / "keys"
    known_as = hosts or [this_host()]
    create(folder, known_as, relays or [])
    text = (
        f"keys in {folder}, for a run that others reach as {', '.join(known_as)}\n"
        f"here       railctl up --listen tls/0.0.0.0:7447 --keys {folder}\n"
        f"elsewhere  railctl join tls/{known_as[0]}:7447 --keys DIR --actors easy=1, with ca.pem, actor.pem and "
        "actor.key in DIR"
    )
    say(text, {"folder": str(folder), "hosts": known_as, "relays": relays or []}, as_json=as_json)
