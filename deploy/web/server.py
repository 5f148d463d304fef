"""The server of the page: static files, what is watched as a stream, tasks, and commands to runs."""

import asyncio
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from railctl.analysis.study import StudyFolder
from railctl.common.bus import NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.levels.distributions import LevelFiles
from railctl.common.rows import DamagedRows
from railctl.common.strict import ConfigError, describe
from railctl.deploy.commands.references import REFERENCE_SCORER
from railctl.deploy.playback import PLAYER
from railctl.deploy.runs import Failed
from railctl.deploy.web.catalogue import Catalogue
from railctl.deploy.web.guard import KEY_HEADER, Guard, Keys
from railctl.deploy.web.listeners import Ending
from railctl.deploy.web.players import page_request, players_of, reference_request
from railctl.deploy.web.scores import references_of
from railctl.deploy.web.steering import Steer, steer
from railctl.deploy.web.stream import MEDIA_TYPE, events
from railctl.deploy.web.tasks import Busy, Tasks
from railctl.deploy.web.watching import Watching

STATIC = Path(__file__).parent / "static"
MOST_SHOWN = 24  # runs in one tab
MOST_BODY_BYTES = 10_000
JSON = "application/json"


class Page:
    """Answers what pages ask."""

    def __init__(self, catalogue: Catalogue, keys: Keys) -> None:
        self._catalogue = catalogue
        self._keys = keys
        self.watching = Watching(catalogue)
        self.tasks = Tasks()
        self._ending = Ending()

    async def index(self, _request: Request) -> Response:
        """The page itself, whatever it shows."""
        return FileResponse(STATIC / "index.html")

    async def session(self, request: Request) -> Response:
        """Whether who asks may steer."""
        may = self._keys.fits(request.headers.get(KEY_HEADER))
        return JSONResponse({"steers": may, "read_only": self._keys.key is None})

    async def list(self, _request: Request) -> Response:
        """All runs and studies."""
        return JSONResponse(await asyncio.to_thread(self._catalogue.documents))

    async def stream(self, request: Request) -> Response:
        """What is known of runs and studies, and what comes."""
        asked = dict.fromkeys(request.query_params.multi_items())
        wanted = [(kind, name) for kind, name in asked if kind in ("run", "study")]
        if not 1 <= len(wanted) <= MOST_SHOWN:
            return _wrong(f"{len(wanted)} runs and studies are asked for: ask for 1 to {MOST_SHOWN}", 400)
        return StreamingResponse(events(self.watching, self._ending, wanted), media_type=MEDIA_TYPE)

    async def players(self, request: Request) -> Response:
        """Who may play which levels of a run."""
        folder = self._catalogue.run(_asked(request, "run"))
        return JSONResponse(await asyncio.to_thread(players_of, folder))

    async def playback(self, request: Request) -> Response:
        """An episode, as `common.playback` describes it."""
        run, player, level, number = (_asked(request, name) for name in ("run", "player", "level", "number"))
        if not number.isdecimal() or len(number) > 9:
            return _wrong(f"number {number}: use the number of an evaluation level", 400)
        folder = self._catalogue.run(run)
        page_request(folder, player, level, int(number), Path())  # or it is wrong before it waits for its turn

        def made(file: Path) -> str:
            request_json: str = page_request(folder, player, level, int(number), file).model_dump_json()
            return request_json

        begun = folder.config_file.stat()  # another run of the name has another one
        key = json.dumps([str(folder.path), begun.st_ino, begun.st_mtime_ns, player, level, number])
        return _compressed(await self.tasks.content(PLAYER, key, made))

    async def references(self, request: Request) -> Response:
        """What reference policies reach on the levels on which a run is evaluated, as far as its study knows."""
        folder = self._catalogue.run(_asked(request, "run"))
        return JSONResponse(await asyncio.to_thread(_references, folder))

    async def score_reference(self, request: Request) -> Response:
        """The same of one policy on one level, scored now: a command, for it takes a core for a while."""
        body = await _body(request)
        run, policy, level = (str(body.get(name, "")) for name in ("run", "policy", "level"))
        folder = self._catalogue.run(run)
        asked = reference_request(folder, policy, level).model_dump_json()
        return _compressed(await self.tasks.content(REFERENCE_SCORER, asked, lambda _file: asked))

    async def steer(self, request: Request) -> Response:
        """Carry out a command."""
        try:
            command = Steer.model_validate(await _body(request))
        except ValidationError as error:
            return _wrong(describe(error, Steer), 400)
        folder = self._catalogue.run(command.run)
        return JSONResponse({"text": await asyncio.to_thread(steer, folder, command)})

    def hang_up(self) -> None:
        """Have streams end, and who waits for a task be told that it was ended."""
        self._ending.begin()
        self.tasks.end()

    def end(self) -> None:
        """End all there is."""
        self.hang_up()
        self.watching.end()


def application(catalogue: Catalogue, keys: Keys) -> tuple[Guard, Page]:
    """What a server serves, and what answers in it."""
    page = Page(catalogue, keys)
    routes = [
        Route("/", page.index),
        Route("/runs/{name:path}", page.index),
        Route("/studies/{name:path}", page.index),
        Route("/compare", page.index),
        Mount("/static", StaticFiles(directory=STATIC)),
        Route("/api/session", page.session),
        Route("/api/list", page.list),
        Route("/api/stream", page.stream),
        Route("/api/players", page.players),
        Route("/api/playback", page.playback),
        Route("/api/references", page.references),
        Route("/api/references", page.score_reference, methods=["POST"]),
        Route("/api/steer", page.steer, methods=["POST"]),
    ]
    app = Starlette(routes=routes, exception_handlers=HANDLERS)
    return Guard(app, keys), page


def _references(folder: RunFolder) -> dict[str, Any]:
    """By level: what the study of the run has scored, and what of its policies may be scored at all."""
    config = folder.config()
    study = StudyFolder(folder.path.resolve().parent.parent)
    is_of_study = folder.path.resolve().parent == study.runs and study.study_file.is_file()
    return {
        level: {
            "scores": references_of(study, level, config.evaluation.levels) if is_of_study else {},
            "scorable": not isinstance(spec, LevelFiles),
        }
        for level, spec in config.world.levels.items()
    }


def _asked(request: Request, name: str) -> str:
    """A value of the address; raises ConfigError if it is missing."""
    value = request.query_params.get(name)
    if value is None:
        raise ConfigError(f"{name} is missing: give it a value")
    return value


async def _body(request: Request) -> dict[str, Any]:
    """The JSON document of a command; raises ConfigError if it is none."""
    content = b""
    async for part in request.stream():
        content += part
        if len(content) > MOST_BODY_BYTES:
            raise ConfigError(f"a command has at most {MOST_BODY_BYTES} bytes")
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise ConfigError("a command is a JSON object")
    return document


def _compressed(content: bytes) -> Response:
    return Response(content, media_type=JSON, headers={"Content-Encoding": "gzip"})


def _wrong(text: str, code: int) -> JSONResponse:
    return JSONResponse({"error": text}, code)


def _handler(code: int) -> Callable[[Request, Exception], Response]:
    def answer(_request: Request, error: Exception) -> Response:
        return _wrong(str(error) or "too many wait already: try again later", code)

    return answer


HANDLERS: Mapping[Any, Any] = {
    ConfigError: _handler(400),
    Failed: _handler(409),
    NoAnswer: _handler(409),
    DamagedRows: _handler(409),
    Busy: _handler(503),
}
