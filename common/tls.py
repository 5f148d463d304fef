"""TLS between machines: addresses, and the certificates by which the two ends of a link know each other's role.

All certificates of a run are of one authority of its own; what a role may do is in `common.wire.rights`.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

LINK = "tls/"
FORM = re.compile(r"tls/(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9][A-Za-z0-9.-]*):([0-9]{1,5})", re.ASCII)
AUTHORITY = "ca.pem"

FarRole = Literal["host", "actor", "reader", "operator", "relay"]


@dataclass(frozen=True)
class Credentials:
    """How one end of a link shows that it has a role: files in a folder that `railctl keys create` has made."""

    folder: Path
    role: FarRole

    @property
    def authority(self) -> Path:
        """The certificate that all others are compared with."""
        return self.folder / AUTHORITY

    @property
    def certificate(self) -> Path:
        return self.folder / f"{self.role}.pem"

    @property
    def key(self) -> Path:
        return self.folder / f"{self.role}.key"


def common_name(role: FarRole) -> str:
    """The name on the certificate of a role."""
    return f"railctl-{role}"


def host_and_port(address: str) -> tuple[str, int]:
    """What an address says.

    >>> host_and_port("tls/0.0.0.0:7447"), host_and_port("tls/[::1]:7447")
    (('0.0.0.0', 7447), ('::1', 7447))

    Raises:
        ValueError: it is none of TLS.
    """
    found = FORM.fullmatch(address)
    if found is None or not 1 <= int(found[2]) <= 65535:
        raise ValueError(f"{address[:80]!r} is not tls/HOST:PORT: write for example tls/0.0.0.0:7447")
    return found[1].strip("[]"), int(found[2])
