"""Addresses of TLS, and which files a role shows."""

from pathlib import Path

import pytest

from railctl.common.tls import Credentials, host_and_port


@pytest.mark.parametrize(
    ("address", "found"),
    [
        ("tls/0.0.0.0:7447", ("0.0.0.0", 7447)),  # noqa: S104
        ("tls/node-7.example.org:1", ("node-7.example.org", 1)),
        ("tls/[fe80::1]:65535", ("fe80::1", 65535)),
    ],
)
def test_an_address_has_a_host_and_a_port(address, found):
    assert host_and_port(address) == found


@pytest.mark.parametrize(
    "address",
    [
        "",
        "tcp/0.0.0.0:7447",
        "tls/0.0.0.0",
        "tls/:7447",
        "tls/node:0",
        "tls/node:65536",
        "tls/node:7447\n",
        "tls/node:7447#iface=eth0",
        "tls/no de:7447",
        "unixsock-stream//tmp/a:1",
    ],
)
def test_other_addresses_are_refused(address):
    with pytest.raises(ValueError, match=r"is not tls/HOST:PORT: write for example tls/0\.0\.0\.0:7447"):
        host_and_port(address)


def test_a_role_shows_files_of_its_own_and_the_authority_of_all():
    credentials = Credentials(Path("keys"), "actor")
    files = (credentials.authority, credentials.certificate, credentials.key)
    assert [str(path) for path in files] == ["keys/ca.pem", "keys/actor.pem", "keys/actor.key"]
