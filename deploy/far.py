"""Reaching the cluster of a run from another machine, by its address."""

import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from railctl.common.bus import Bus, NoAnswer, open_bus
from railctl.common.records.control import Empty
from railctl.common.records.joining import RunIntroduction
from railctl.common.strict import ConfigError
from railctl.common.tls import LINK, Credentials, FarRole, host_and_port
from railctl.common.wire import keys
from railctl.common.wire.keys import ROOT
from railctl.deploy.certificates import check

CONNECT_TIMEOUT_S = 5.0
ASK_TIMEOUT_S = 5.0


def credentials_for(address: str, folder: Path, role: FarRole) -> Credentials:
    """What a role shows at an address; both are seen to be good.

    Raises:
        ConfigError: the address is none, or a file of the role is not good.
    """
    try:
        host_and_port(address)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    credentials = Credentials(folder.absolute(), role)
    check(credentials)
    return credentials


class Place(NamedTuple):
    """Where a run is reached from another machine, and as whom."""

    address: str
    credentials: Credentials


def place_of(run: str | None, folder: Path | None, *roles: FarRole) -> Place | None:
    """The place that a user gives instead of a run's name, as an address and a folder of keys; None: it is a name.

    Args:
        run: name, folder or address.
        folder: of the keys.
        roles: those that will do; the first is taken whose files are there.

    Raises:
        ConfigError: an address or keys are given without the other, or the files of no role are good.
    """
    is_address = run is not None and run.startswith(LINK)
    if is_address and folder is None:
        raise ConfigError(f"{run}: an address takes keys: add --keys DIR, with those of a {' or an '.join(roles)}")
    if folder is not None and not is_address:
        raise ConfigError(f"--keys {folder}: only the address of a run takes keys, as tls/node7:7447: leave them out")
    if run is None or folder is None:
        return None
    role = next((role for role in roles if Credentials(folder, role).key.exists()), roles[0])
    return Place(run, credentials_for(run, folder, role))


def introduced(address: str, credentials: Credentials) -> RunIntroduction:
    """The run of the cluster at an address.

    Raises:
        NoAnswer: nobody is there, or not who should be, or the run does not answer.
    """
    shake_hands(address, credentials)
    with open_bus(address, ROOT, CONNECT_TIMEOUT_S, credentials=credentials) as bus:
        return introduction(bus, address, ASK_TIMEOUT_S)


def introduction(bus: Bus, address: str, timeout_s: float) -> RunIntroduction:
    """The run at the other end of a bus that is connected with an address; raises as `introduced`."""
    try:
        return bus.ask(keys.RUN, Empty(), timeout_s)
    except NoAnswer:
        raise NoAnswer(
            f"{address}: no run says its name: railctl status tells there whether it is supervised"
        ) from None


def shake_hands(address: str, credentials: Credentials) -> None:
    """See that the host at an address is who it should be: Zenoh says only that it cannot connect.

    Raises:
        NoAnswer: it is not, or nobody is there.
    """
    host, port = host_and_port(address)
    context = ssl.create_default_context(cafile=credentials.authority)
    context.load_cert_chain(credentials.certificate, credentials.key)
    try:
        with socket.create_connection((host, port), CONNECT_TIMEOUT_S) as plain:
            context.wrap_socket(plain, server_hostname=host).close()
    except ssl.SSLCertVerificationError as error:
        remedy = f"railctl keys create --host {host} makes keys for it, and {credentials.folder} must be of the same"
        raise NoAnswer(f"{address}: {error.verify_message.rstrip('.')}: {remedy}") from None
    except (ssl.SSLError, OSError) as error:
        remedy = f"is the run up with --listen, and does a firewall let port {port} through?"
        raise NoAnswer(f"{address}: {error.strerror or error}: {remedy}") from None


@contextmanager
def reach_far(address: str, credentials: Credentials) -> Iterator[tuple[Bus, RunIntroduction]]:
    """The bus of the run at an address, and what is told of it; raises as `introduced`."""
    run = introduced(address, credentials)
    with open_bus(address, run.namespace, CONNECT_TIMEOUT_S, credentials=credentials) as bus:
        yield bus, run
