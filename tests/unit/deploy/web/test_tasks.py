"""Tasks of pages: one at a time, kept, and ended."""

import asyncio
import gzip
import threading

import pytest

from railctl.deploy.runs import Failed
from railctl.deploy.web import tasks
from railctl.deploy.web.tasks import MOST_WAITING, Busy, Tasks


class Made:
    """A task that writes what it was asked, once it may."""

    may_end = threading.Event()
    waits = threading.Event()
    begun = 0
    now = most = 0

    def __init__(self, _module, request):
        self.request = request
        Made.begun += 1

    def wait(self):
        Made.now += 1
        Made.most = max(Made.most, Made.now)
        Made.waits.set()
        assert Made.may_end.wait(30.0)
        Made.now -= 1

    def result(self):
        if self.request.startswith("wrong"):
            raise Failed("it went wrong")
        return {"said": self.request.partition(" ")[0]}

    def end(self):
        Made.may_end.set()


@pytest.fixture(autouse=True)
def made(monkeypatch):
    monkeypatch.setattr(tasks, "Task", Made)
    Made.may_end, Made.waits = threading.Event(), threading.Event()
    Made.may_end.set()
    Made.begun = Made.now = Made.most = 0


def content(of, key, request):
    return asyncio.run(of.content("module", key, request))


def test_what_has_come_is_kept():
    of = Tasks()
    first = content(of, "a", lambda _file: "one")
    assert gzip.decompress(first) == b'{"said": "one"}'
    assert content(of, "a", lambda _file: "another") == first
    assert Made.begun == 1


def test_the_file_that_is_written_counts():
    def write(file):
        file.write_text("written")
        return "one"

    assert gzip.decompress(content(Tasks(), "a", write)) == b"written"


def test_what_went_wrong_is_not_kept():
    of = Tasks()
    with pytest.raises(Failed, match="it went wrong"):
        content(of, "a", lambda _file: "wrong")
    assert gzip.decompress(content(of, "a", lambda _file: "right")) == b'{"said": "right"}'


def test_one_works_at_a_time_and_so_many_wait():
    async def ask():
        of = Tasks()
        asked = [
            asyncio.ensure_future(of.content("module", str(number), lambda _file: "one"))
            for number in range(MOST_WAITING)
        ]
        await asyncio.sleep(0)
        with pytest.raises(Busy):
            await of.content("module", "more", lambda _file: "one")
        await asyncio.gather(*asked)

    asyncio.run(ask())
    assert (Made.begun, Made.most) == (MOST_WAITING, 1)


def test_the_eldest_go_when_they_take_too_much_room(monkeypatch):
    monkeypatch.setattr(tasks, "MOST_KEPT_BYTES", 90)
    of = Tasks()
    for name in "abc":
        content(of, name, lambda _file, name=name: name)
    content(of, "a", lambda _file: "a")
    assert Made.begun == 4


def test_what_works_is_ended():
    async def ask():
        of = Tasks()
        Made.may_end.clear()
        asked = asyncio.ensure_future(of.content("module", "a", lambda _file: "one"))
        assert await asyncio.to_thread(Made.waits.wait, 30.0)
        of.end()
        await asked

    asyncio.run(ask())
