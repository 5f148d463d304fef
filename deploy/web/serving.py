"""Serving the page on loopback until Ctrl-C, and opening it without showing its key to others."""

import logging
import os
import resource
import signal
import socket
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from urllib.parse import quote

import uvicorn

from railctl.deploy.runs import Failed
from railctl.deploy.termination import terminable
from railctl.deploy.web.catalogue import Catalogue
from railctl.deploy.web.guard import Keys
from railctl.deploy.web.server import application

ADDRESS = "127.0.0.1"
PORT = 8710
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
END_S = 2
TRIED = 50  # ports from PORT on


class Server(uvicorn.Server):
    """Ends at the first signal: streams do not end by themselves, they are ended."""

    def __init__(self, config: uvicorn.Config, on_end: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_end = on_end

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        super().handle_exit(sig, frame)
        self._on_end()


def serve(catalogue: Catalogue, listening: socket.socket, keys: Keys) -> None:
    """Serve the page until a signal comes."""
    logging.getLogger("uvicorn").setLevel(logging.ERROR)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # a thousand open connections stop nobody else
    app, page = application(catalogue, keys)
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        lifespan="off",
        ws="none",
        loop="asyncio",
        server_header=False,
        timeout_graceful_shutdown=END_S,
    )
    try:
        with terminable():
            Server(config, page.hang_up).run(sockets=[listening])
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is ending
        page.end()


def listen(port: int | None) -> socket.socket:
    """A socket on loopback: on a port that is asked for, or else the first free one of some.

    Raises:
        Failed: there is none.
    """
    for tried in [port] if port is not None else range(PORT, PORT + TRIED):
        found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port that was used a minute ago is free
        try:
            found.bind((ADDRESS, tried))
        except OSError as error:
            found.close()
            reason = error.strerror
        else:
            found.listen()
            return found
    asked = f"ports {PORT} to {PORT + TRIED - 1}" if port is None else f"--port {port}"
    raise Failed(f"{asked}: {reason}: give a free port, or 0 for any")


def address(listening: socket.socket, catalogue: Catalogue, keys: Keys) -> str:
    """Where a browser finds what the command named, and the key, in the part that is sent to nobody."""
    host, port = listening.getsockname()
    fragment = "" if keys.key is None else f"#key={keys.key}"
    return f"http://{host}:{port}{place(catalogue.named)}{fragment}"


def place(named: list[tuple[str, str]]) -> str:
    """The path of a page.

    >>> place([]), place([("run", "w")]), place([("study", "mini")]), place([("run", "a"), ("run", "b")])
    ('/', '/runs/w', '/studies/mini', '/compare?run=a&run=b')
    """
    if len(named) > 1:
        return "/compare?" + "&".join(f"{kind}={quote(name)}" for kind, name in named if kind == "run")
    return "".join(f"/{'runs' if kind == 'run' else 'studies'}/{quote(name)}" for kind, name in named) or "/"


@contextmanager
def opened(url: str) -> Iterator[None]:
    """Have the user's browser open a page, by a file that only the user can read.

    Everybody sees the arguments of commands, and one of these would have the key in it.
    """
    if not any(os.environ.get(name) for name in DISPLAYS):
        yield  # a browser in the terminal would take it away from this command
        return
    with tempfile.TemporaryDirectory(prefix="railctl-watch-") as folder:
        file = Path(folder) / "open.html"
        file.write_text(
            f'<!doctype html><meta http-equiv="refresh" content="0;url={url}"><a href="{url}">railctl</a>\n'
        )
        webbrowser.open(file.as_uri())
        yield
