"""What is watched, as server-sent events: each part when it is news, and a sign of life when nothing is."""

import asyncio
import json
from collections.abc import AsyncIterator, Sequence
from contextlib import ExitStack

from railctl.common.strict import ConfigError
from railctl.deploy.web.listeners import Ending
from railctl.deploy.web.looker import Looker
from railctl.deploy.web.watching import TooMany, Watching

MEDIA_TYPE = "text/event-stream"
AT_LEAST_S = 0.4  # between two looks for news
ALIVE_S = 5.0
RETRY_MS = 1000


async def events(watching: Watching, ending: Ending, wanted: Sequence[tuple[str, str]]) -> AsyncIterator[str]:
    """The events of all that is wanted, by kind and name, until the reader goes or the server ends."""
    news = asyncio.Event()
    news.set()
    sent: dict[tuple[str, str, str], int] = {}
    yield f"retry: {RETRY_MS}\n\n"
    with ExitStack() as stack:
        stack.enter_context(ending.listening(news))
        lookers = []
        for kind, name in wanted:
            try:
                looker = stack.enter_context(watching.shown(kind, name))
            except ConfigError as error:
                yield _event("problem", json.dumps({"kind": kind, "name": name, "text": str(error)}))
            except TooMany:
                text = "too many runs are shown already: close other tabs"
                yield _event("problem", json.dumps({"kind": kind, "name": name, "text": text}))
            else:
                stack.enter_context(looker.listeners.listening(news))
                lookers.append(looker)
        while not ending.over:
            try:
                await asyncio.wait_for(news.wait(), ALIVE_S)
            except TimeoutError:
                yield _event("alive", "{}")
                continue
            news.clear()
            for event in _news(lookers, sent):
                yield event
            await asyncio.sleep(AT_LEAST_S)


def _news(lookers: Sequence[Looker], sent: dict[tuple[str, str, str], int]) -> list[str]:
    """The parts of which another version has been sent, or none."""
    found = []
    for looker in lookers:
        for part, (version, body) in looker.parts.items():
            key = (looker.kind, looker.name, part)
            if sent.get(key) != version:
                sent[key] = version
                found.append(_event(part, body))
    return found


def _event(kind: str, data: str) -> str:
    """Data is JSON in one line."""
    return f"event: {kind}\ndata: {data}\n\n"
