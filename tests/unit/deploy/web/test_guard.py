"""Who may read and who may steer: names, origins, and the key."""

import pytest
from starlette.datastructures import Headers

from railctl.deploy.web.guard import KEY_HEADER, Keys, refusal

HOST = "127.0.0.1:8710"
KEYS = Keys(read_only=False)
STEERS = {"host": HOST, "origin": f"http://{HOST}", KEY_HEADER: KEYS.key}


def refused(method, path, headers, keys=KEYS):
    return refusal(method, path, Headers(headers), keys)


@pytest.mark.parametrize("host", [HOST, "localhost:8710", "localhost", "127.0.0.1:22222"])
def test_the_page_is_read_by_its_own_names(host):
    assert refused("GET", "/", {"host": host}) is None


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8710", "127.0.0.1.evil.example", "", "10.0.0.1:8710", "[::1]:8710"]
)
def test_a_name_that_was_bound_to_loopback_is_refused(host):
    assert "answers to" in refused("GET", "/", {"host": host})
    assert "answers to" in refused("POST", "/api/steer", STEERS | {"host": host})


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_pages_of_others_read_no_data(site):
    assert "other sites" in refused("GET", "/api/list", {"host": HOST, "sec-fetch-site": site})
    assert refused("GET", "/", {"host": HOST, "sec-fetch-site": site}) is None  # a link to the page


@pytest.mark.parametrize("site", ["none", "same-origin"])
def test_the_page_itself_reads_data(site):
    assert refused("GET", "/api/list", {"host": HOST, "sec-fetch-site": site}) is None


def test_with_the_key_the_page_steers():
    assert refused("POST", "/api/steer", STEERS) is None


@pytest.mark.parametrize(
    "key",
    [None, "", "wrong", KEYS.key[:-1], KEYS.key + "x", "ключ"],
    ids=["none", "empty", "wrong", "short", "long", "no letters of ASCII"],
)
def test_without_the_key_nobody_steers(key):
    headers = {name: value for name, value in STEERS.items() if name != KEY_HEADER}
    raw = [(name.encode(), value.encode()) for name, value in headers.items()]
    raw += [] if key is None else [(KEY_HEADER.lower().encode(), key.encode())]
    assert "has a key" in refusal("POST", "/api/steer", Headers(raw=raw), KEYS)


@pytest.mark.parametrize(
    "origin", [None, "null", "http://evil.example", f"https://{HOST}", "http://127.0.0.1:9", "http://localhost:8710"]
)
def test_another_origin_does_not_steer_even_with_the_key(origin):
    headers = {name: value for name, value in STEERS.items() if name != "origin"}
    assert "own page" in refused("POST", "/api/steer", headers | ({} if origin is None else {"origin": origin}))


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS"])
def test_what_only_shows_lets_nobody_steer(method):
    assert "--read-only" in refused(method, "/api/steer", STEERS, Keys(read_only=True))


def test_every_server_has_a_key_of_its_own():
    assert len({Keys(read_only=False).key for _ in range(10)}) == 10
    assert not Keys(read_only=True).fits(None)
