"""Whether this machine can listen for others at an address; Zenoh says it only in words of its own."""

import socket

from railctl.common.tls import host_and_port
from railctl.deploy.runs import Failed


def check_free(field: str, address: str) -> None:
    """Raises Failed, naming the field that says so, if nobody can listen at an address of TLS."""
    host, port = host_and_port(address)
    try:
        family, *_, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as routers do
            probe.bind(place)
    except OSError as error:
        remedy = "give a free port, and 0.0.0.0 or an address of this machine"
        raise Failed(f"{field} {address}: {error.strerror}: {remedy}") from None
