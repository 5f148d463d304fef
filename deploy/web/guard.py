"""Who may ask the page's server for what.

It listens on loopback alone. Reading is free there; steering needs the key, which only the page of whoever started the
server has: it comes in the fragment of the address, which browsers send to nobody, and goes out in a header, which no
other site's page can add. Not in a cookie: browsers send those to every port of a host, so also to a server of another
user of this machine. That a page of another site reads with the help of the user's browser is refused by the names in
`Host` (which a rebound name of DNS cannot forge) and by what browsers say of where a request comes from.
"""

import hmac
import json
import secrets
from collections.abc import Mapping
from typing import Any

from starlette.datastructures import Headers, MutableHeaders

HOSTS = ("127.0.0.1", "localhost")
KEY_HEADER = "X-Railctl-Key"
READS = ("GET", "HEAD")
API = "/api/"
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}


class Keys:
    """The key of this server, which nobody steers without; None: nobody steers at all."""

    def __init__(self, *, read_only: bool) -> None:
        self.key = None if read_only else secrets.token_urlsafe(32)

    def fits(self, given: str | None) -> bool:
        """Whether somebody has the key."""
        return self.key is not None and given is not None and hmac.compare_digest(self.key.encode(), given.encode())


def refusal(method: str, path: str, headers: Headers, keys: Keys) -> str | None:
    """Why a request is not answered; None if it is."""
    host = headers.get("host", "")
    if host.rpartition(":")[0] not in HOSTS and host not in HOSTS:  # any port: it may be forwarded from another one
        return f"this server answers to {' and '.join(HOSTS)} alone"
    comes_from = headers.get("sec-fetch-site", "same-origin")
    if path.startswith(API) and comes_from not in ("same-origin", "none"):
        return "pages of other sites may not read here"
    return None if method in READS else _refused_command(headers, keys)


def _refused_command(headers: Headers, keys: Keys) -> str | None:
    if headers.get("origin") != f"http://{headers.get('host')}":
        return "commands come from this server's own page alone"
    if keys.key is None:
        return "this page only shows: it was started with --read-only"
    if not keys.fits(headers.get(KEY_HEADER)):
        return "this page only shows: open it by the address that railctl watch prints, which has a key, to steer"
    return None


class Guard:
    """An ASGI application around another one, which it lets hear only what is answered."""

    def __init__(self, app: Any, keys: Keys) -> None:
        self._app = app
        self._keys = keys

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
                headers.setdefault("Cache-Control", "no-store" if scope["path"].startswith(API) else "no-cache")
            await send(message)

        reason = refusal(scope["method"], scope["path"], Headers(scope=scope), self._keys)
        if reason is None:
            await self._app(scope, receive, send_with_headers)
            return
        body = json.dumps({"error": reason}).encode()
        start = {"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"application/json")]}
        await send_with_headers(start)
        await send({"type": "http.response.body", "body": body})
