"""What nobody but its user reaches."""

import stat
from pathlib import Path

import pytest

from railctl.common.bus import open_bus, open_router
from railctl.common.private import LINK, is_private, private_endpoint, private_files, remove_endpoint


@pytest.fixture
def endpoint():
    made = private_endpoint()
    yield made
    remove_endpoint(made)


def folder_of(endpoint):
    return Path(endpoint.removeprefix(LINK)).parent


def test_a_socket_lies_in_a_folder_that_only_its_owner_enters(endpoint):
    assert stat.S_IMODE(folder_of(endpoint).stat().st_mode) == 0o700
    assert is_private(endpoint)
    with open_router(endpoint), open_bus(endpoint, "test", 10.0) as bus:
        assert bus.connected()


def test_an_endpoint_goes_with_its_folder(endpoint):
    with open_router(endpoint):
        pass
    remove_endpoint(endpoint)
    assert not folder_of(endpoint).exists()
    assert not is_private(endpoint)
    remove_endpoint(endpoint)


def test_what_others_could_enter_is_not_private(endpoint, tmp_path):
    folder_of(endpoint).chmod(0o710)
    assert not is_private(endpoint)
    folder_of(endpoint).chmod(0o700)
    (tmp_path / "link").symlink_to(folder_of(endpoint))
    assert not is_private(f"{LINK}{tmp_path}/link/router")
    assert not is_private("tcp/127.0.0.1:7447")
    assert not is_private("")


def test_files_made_within_are_private(tmp_path):
    with private_files():
        (tmp_path / "mine").touch()
        (tmp_path / "folder").mkdir()
    (tmp_path / "other").touch()
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert (modes["mine"], modes["folder"]) == (0o600, 0o700)
    assert modes["other"] != 0o600
