"""railctl relay: a second router, on a site far from a run's host."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.common.bus import open_relay
from railctl.common.process import Stopping
from railctl.common.strict import ConfigError
from railctl.common.tls import host_and_port
from railctl.deploy.far import credentials_for, shake_hands
from railctl.deploy.listening import check_free
from railctl.deploy.output import console, one_line_errors
from railctl.deploy.runs import Failed

LOOK_S = 0.5


@one_line_errors
def relay(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="Of the run's machine, as tls/node7:7447.")],
    keys: Annotated[Path, typer.Option(metavar="DIR", help="Folder with ca.pem, relay.pem and relay.key.")],
    listen: Annotated[str, typer.Option(metavar="ADDRESS", help="Where others join, as tls/0.0.0.0:7447.")],
) -> None:
    """Link machines that join here to a run's host, by one link, until Ctrl-C."""
    credentials = credentials_for(address, keys, "relay")
    try:
        host_and_port(listen)
    except ValueError as error:
        raise ConfigError(f"--listen: {error}") from None
    check_free("--listen", listen)
    shake_hands(address, credentials)
    stopping, was_linked = Stopping(), False
    try:
        with open_relay(listen, address, credentials) as linked:
            while not stopping.asked:
                if linked() != was_linked:
                    was_linked = not was_linked
                    _tell(f"links {listen} to {address}" if was_linked else f"no link to {address}: waits for it")
                stopping.wait(LOOK_S)
    except OSError as error:
        raise Failed(f"{error}: is the port free?") from None


def _tell(text: str) -> None:
    console.print(text, markup=False, soft_wrap=True)
