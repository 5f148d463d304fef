"""Certificates for the machines of a run: made, and seen to be good before anything is started with them.

The authority signs once and its key is thrown away: nobody can ever make another certificate that a run would take.
"""

import ipaddress
import os
import re
import shutil
import socket
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import get_args

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from railctl.common.private import FOLDER_MODE, private_files
from railctl.common.strict import ConfigError
from railctl.common.tls import AUTHORITY, Credentials, FarRole, common_name
from railctl.deploy.runs import Failed

LIFETIME = timedelta(days=3 * 365)
SLACK = timedelta(days=1)  # of the clocks of other machines
LABEL = re.compile("[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?")  # of a name, between dots
HERE = ("localhost", "127.0.0.1")
REMEDY = "make keys anew with railctl keys create, or copy those that the run's host has"


def create(folder: Path, hosts: Sequence[str], relays: Sequence[str] = ()) -> None:
    """Make the keys of an authority of its own and of every role, in a folder that only its user may enter.

    Args:
        folder: there must be none yet.
        hosts: names and addresses by which other machines reach the run's host.
        relays: those by which they reach relays; without any there are no keys for relays.

    Raises:
        ConfigError: one of these is no name or address.
        Failed: the folder is there already, or cannot be made.
    """
    names: dict[FarRole, list[x509.GeneralName]] = {
        "host": _names_or_addresses("host", hosts),
        "relay": _names_or_addresses("relay", relays),
    }
    signer = ec.generate_private_key(ec.SECP256R1())
    authority = _authority(signer)
    if folder.exists():
        raise Failed(f"{folder} is there already, and keys are never overwritten: give another folder")
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}")
    try:
        temporary.parent.mkdir(parents=True, exist_ok=True)
        with private_files():
            temporary.mkdir(FOLDER_MODE)
            (temporary / AUTHORITY).write_bytes(authority.public_bytes(Encoding.PEM))
            for role in get_args(FarRole):
                if role != "relay" or relays:
                    _write(Credentials(temporary, role), authority, signer, names.get(role, []))
        temporary.rename(folder)
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        raise Failed(f"cannot create {folder}: {error.strerror}: give a folder that you may write") from None


def this_host() -> str:
    """The name of this machine."""
    return socket.gethostname()


def check(credentials: Credentials) -> None:
    """See that a role can show itself with these files.

    Raises:
        ConfigError: one is missing, is not what its name says, or is out of date.
    """
    authority, certificate = _read(credentials.authority), _read(credentials.certificate)
    key = _key(credentials.key)
    name = common_name(credentials.role)
    if _names(certificate) != [name]:
        raise ConfigError(f"{credentials.certificate}: is the certificate of {_names(certificate)}, not of {name}")
    if key != certificate.public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo):
        raise ConfigError(f"{credentials.key}: is not the key of {credentials.certificate}: {REMEDY}")
    try:
        certificate.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError):
        raise ConfigError(f"{credentials.certificate}: {credentials.authority} has not signed it: {REMEDY}") from None
    for path, found in ((credentials.authority, authority), (credentials.certificate, certificate)):
        _check_time(path, found)


def _check_time(path: Path, certificate: x509.Certificate) -> None:
    now, first, last = datetime.now(UTC), certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if not first <= now <= last:
        raise ConfigError(f"{path}: is good from {first:%Y-%m-%d} to {last:%Y-%m-%d} only: {REMEDY}")


def _read(path: Path) -> x509.Certificate:
    content = _bytes(path)
    try:
        return x509.load_pem_x509_certificate(content)
    except ValueError:
        raise ConfigError(f"{path}: is no certificate in PEM: {REMEDY}") from None


def _key(path: Path) -> bytes:
    """The public half of a private key."""
    content = _bytes(path)
    try:
        key = load_pem_private_key(content, None)
    except (ValueError, TypeError):
        raise ConfigError(f"{path}: is no key in PEM without a password: {REMEDY}") from None
    return key.public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}: {REMEDY}") from None


def _names(certificate: x509.Certificate) -> list[str]:
    return [str(part.value) for part in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]


def _names_or_addresses(role: FarRole, hosts: Sequence[str]) -> list[x509.GeneralName]:
    """By which machines of a role are reached, also from themselves."""
    return [_name_or_address(role, host) for host in dict.fromkeys([*hosts, *HERE])]


def _name_or_address(role: FarRole, host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    labels = host.split(".")
    is_number = labels[-1].isdecimal()  # whatever looks for it takes it for an address
    if all(LABEL.fullmatch(label) for label in labels) and not is_number and len(host) <= 253:
        return x509.DNSName(host)
    raise ConfigError(f"--{role} {host!r}: is no name or address of a machine: write for example --{role} node7")


def _authority(signer: ec.EllipticCurvePrivateKey) -> x509.Certificate:
    name = _subject("railctl-authority")
    usage = x509.KeyUsage(
        key_cert_sign=True,
        crl_sign=True,
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
    builder = _builder(name, name, signer.public_key()).add_extension(usage, critical=True)
    return builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True).sign(
        signer, hashes.SHA256()
    )


def _write(
    credentials: Credentials,
    authority: x509.Certificate,
    signer: ec.EllipticCurvePrivateKey,
    names: Sequence[x509.GeneralName],
) -> None:
    """The files of one role; `names` are for those that others connect to. The host never connects to others."""
    purposes = [ExtendedKeyUsageOID.SERVER_AUTH] if names else []
    if credentials.role != "host":
        purposes.append(ExtendedKeyUsageOID.CLIENT_AUTH)
    key = ec.generate_private_key(ec.SECP256R1())
    builder = _builder(_subject(common_name(credentials.role)), authority.subject, key.public_key())
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=True)
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key())
    builder = builder.add_extension(issuer, critical=False)
    if names:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    certificate = builder.sign(signer, hashes.SHA256())
    credentials.certificate.write_bytes(certificate.public_bytes(Encoding.PEM))
    credentials.key.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))


def _builder(name: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(issuer).public_key(key)
    builder = builder.serial_number(x509.random_serial_number()).not_valid_before(now - SLACK)
    identifier = x509.SubjectKeyIdentifier.from_public_key(key)
    return builder.not_valid_after(now + LIFETIME).add_extension(identifier, critical=False)


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
