"""Keys: made once, whole, private; and whatever is wrong with one is said before anything is started with it."""

import re
import shutil
import stat
from datetime import UTC, datetime, timedelta

import pytest
from command_line import complaint, railctl
from cryptography import x509

from railctl.common.strict import ConfigError
from railctl.common.task import FAILED, WRONG_USAGE
from railctl.common.tls import Credentials
from railctl.deploy import certificates
from railctl.deploy.certificates import LIFETIME, check, create

ROLES = ("host", "actor", "reader", "operator", "relay")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "keys"
    create(folder, ["node7", "10.1.2.3"], ["gate"])
    return folder


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "keys")


def wrong(folder, role="actor"):
    with pytest.raises(ConfigError) as caught:
        check(Credentials(folder, role))
    text = str(caught.value)
    assert "\n" not in text
    return text.replace(f"{folder}/", "")


def test_every_role_has_a_certificate_and_a_key_and_nobody_keeps_that_of_the_authority(made):
    files = {path.name for path in made.iterdir()}
    assert files == {"ca.pem", *(f"{role}.{end}" for role in ROLES for end in ("pem", "key"))}
    for role in ROLES:
        check(Credentials(made, role))


def test_they_are_their_users_alone(made):
    assert stat.S_IMODE(made.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in made.iterdir()} == {0o600}


def test_the_host_is_known_by_its_names_and_addresses_and_by_those_of_its_own_machine(made):
    host = x509.load_pem_x509_certificate((made / "host.pem").read_bytes())
    names = host.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["node7", "localhost"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["10.1.2.3", "127.0.0.1"]


def test_only_host_and_relay_are_to_connect_to_and_the_host_connects_to_nobody(made):
    for role in ROLES:
        certificate = x509.load_pem_x509_certificate((made / f"{role}.pem").read_bytes())
        purposes = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        wanted = {"host": ["serverAuth"], "relay": ["serverAuth", "clientAuth"]}.get(role, ["clientAuth"])
        assert [purpose._name for purpose in purposes] == wanted


def test_there_are_keys_for_a_relay_only_if_there_is_one(tmp_path):
    create(tmp_path / "keys", ["node7"])
    assert not list((tmp_path / "keys").glob("relay*"))


def test_a_relay_is_known_by_its_own_names(made):
    relay = x509.load_pem_x509_certificate((made / "relay.pem").read_bytes())
    names = relay.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["gate", "localhost"]


@pytest.mark.parametrize("name", ["ca.pem", "actor.pem", "actor.key"])
def test_a_file_that_is_missing_or_is_none_is_named(folder, name):
    (folder / name).write_text("nothing")
    assert wrong(folder).startswith(f"{name}: is no ")
    (folder / name).unlink()
    assert wrong(folder).startswith(f"{name} cannot be read: No such file or directory: make keys anew with ")


def test_what_another_role_needs_need_not_be_there(folder):
    for role in ("host", "reader", "operator"):
        Credentials(folder, role).key.unlink()
        Credentials(folder, role).certificate.unlink()
    check(Credentials(folder, "actor"))


def test_the_certificate_of_another_role_is_named(folder):
    shutil.copy(folder / "reader.pem", folder / "actor.pem")
    assert wrong(folder) == "actor.pem: is the certificate of ['railctl-reader'], not of railctl-actor"


def test_the_key_of_another_certificate_is_named(folder):
    shutil.copy(folder / "reader.key", folder / "actor.key")
    assert wrong(folder).startswith("actor.key: is not the key of actor.pem: ")


def test_keys_of_another_making_do_not_mix(folder, tmp_path):
    create(tmp_path / "other", [])
    shutil.copy(tmp_path / "other" / "ca.pem", folder)
    assert wrong(folder).startswith("actor.pem: ca.pem has not signed it: ")


@pytest.mark.parametrize("shift", [LIFETIME + timedelta(days=1), -timedelta(days=2)])
def test_keys_that_are_out_of_date_are_named(folder, monkeypatch, shift):
    class Later(datetime):
        @classmethod
        def now(cls, _zone):
            return datetime.now(UTC) + shift

    monkeypatch.setattr(certificates, "datetime", Later)
    assert re.match(r"ca\.pem: is good from \d{4}-\d\d-\d\d to \d{4}-\d\d-\d\d only: ", wrong(folder))


# railctl keys create


def test_keys_are_never_overwritten(folder):
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert complaint(FAILED, "keys", "create", str(folder)) == (
        f"railctl: {folder} is there already, and keys are never overwritten: give another folder"
    )
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_keys_lie_beside_the_runs_unless_a_folder_is_given(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    assert (
        f"keys in {tmp_path}/keys, for a run that others reach as node7"
        in railctl("keys", "create", "--host", "node7").stdout
    )
    check(Credentials(tmp_path / "keys", "host"))


@pytest.mark.parametrize(
    "host", ["a b", "node7:7447", "tls/node7", "a..b", "é", "x" * 254, "x" * 64, "999.1.1.1", "-a", "a-.b"]
)
def test_what_is_no_name_of_a_machine_is_refused_and_nothing_is_made(tmp_path, host):
    text = complaint(WRONG_USAGE, "keys", "create", str(tmp_path / "keys"), "--host", host)
    assert text.startswith(f"railctl: --host {host!r}: is no name or address of a machine: ")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_leaves_nothing_behind(tmp_path, monkeypatch):
    def refuse(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(certificates, "_write", refuse)
    text = complaint(FAILED, "keys", "create", str(tmp_path / "keys"))
    assert text.startswith(f"railctl: cannot create {tmp_path}/keys: No space left on device: ")
    assert list(tmp_path.iterdir()) == []
