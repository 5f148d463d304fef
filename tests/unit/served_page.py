"""The page of `railctl watch`, served by a thread of this process for tests that ask it over a real socket."""

import http.client
import json
import threading
from contextlib import contextmanager
from types import SimpleNamespace
from urllib.parse import urlencode

import uvicorn

from railctl.deploy.web.catalogue import catalogue_of
from railctl.deploy.web.guard import KEY_HEADER, Keys
from railctl.deploy.web.server import application
from railctl.deploy.web.serving import address, listen

PATIENCE_S = 60.0


class Served:
    """A page that is served, and a client of it that may have the key."""

    def __init__(self, *names, read_only=False, port=0):
        self.keys = Keys(read_only=read_only)
        self._catalogue = catalogue_of(names)
        self._socket = listen(port)
        self.host = "{}:{}".format(*self._socket.getsockname())
        self.url = address(self._socket, self._catalogue, self.keys)
        app, self.page = application(self._catalogue, self.keys)
        config = uvicorn.Config(app, log_config=None, access_log=False, lifespan="off", ws="none", loop="asyncio")
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [self._socket]}, daemon=True)
        self._thread.start()

    @property
    def port(self):
        return int(self.host.rpartition(":")[2])

    def get(self, path, headers=None, **values):
        return self._ask("GET", f"{path}?{urlencode(values)}" if values else path, None, headers or {})

    def post(self, path, document, *, key=True, headers=None):
        """Post a document as this page would, unless headers say otherwise."""
        own = {"Origin": f"http://{self.host}"} | ({KEY_HEADER: self.keys.key} if key and self.keys.key else {})
        body = document if isinstance(document, bytes) else json.dumps(document).encode()
        return self._ask("POST", path, body, own | (headers or {}))

    @contextmanager
    def stream(self, query):
        """The events of a stream, as pairs of kind and document, while the block lasts."""
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        connection.request("GET", f"/api/stream?{query}")
        try:
            yield self._events(connection.getresponse())
        finally:
            connection.close()

    def _events(self, response):
        kind = None
        for line in iter(response.readline, b""):
            name, _, value = line.decode().rstrip("\n").partition(": ")
            if name == "event":
                kind = value
            elif name == "data":
                yield kind, json.loads(value)

    def _ask(self, method, path, body, headers):
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            return SimpleNamespace(code=answer.status, headers=answer.headers, body=answer.read())
        finally:
            connection.close()

    def end(self):
        self._server.should_exit = True
        self.page.end()
        self._thread.join(PATIENCE_S)
