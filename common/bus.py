"""The only place that knows Zenoh: typed topics, services and liveliness over one session.

Whatever arrives goes into one inbox at once, and one thread decodes it and hands it to callbacks in the order of
arrival, across topics and services: what an actor publishes before it asks is known when its question is. That thread
is the bus's own, or that of a loop which takes from the inbox itself: a message then changes hands once less. A full
channel would stall the whole link, so the inbox is not bounded; the leases bound the work in flight, and of each
service only so many questions wait: the others end without an answer. What does not decode is refused: counted, logged,
answered with an error.
"""

import json
import logging
import queue
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import zenoh

from railctl.common import sessions
from railctl.common.inbox import Inbox
from railctl.common.records.base import Record
from railctl.common.sessions import Door
from railctl.common.sparing import is_told
from railctl.common.tls import Credentials
from railctl.common.wire.codec import Refused, decode, encode, encoding_of
from railctl.common.wire.keys import Alive, Service, Topic, absolute

A = TypeVar("A", bound=Record)
B = TypeVar("B", bound=Record)

log = logging.getLogger(__name__)

STRETCH_S = 0.1
MAX_REASON_BYTES = 1000
MOST_QUESTIONS = 2000  # of a service that wait; more than a run has processes
GRACE_S = 1.0  # zenoh itself ends a question at its time-out; this is for when it does not


class NoAnswer(Exception):  # noqa: N818  (an outcome, not an error: the caller decides)
    """Nobody answered, or the one who did sent nothing usable; the text says which."""


@dataclass
class Traffic:
    """What has come and gone: messages, whatever their kind, and the bytes of their bodies, `size`."""

    messages: int = 0
    size: int = 0

    def counted(self, body: bytes) -> bytes:
        """Count a message; returns its body."""
        self.messages += 1
        self.size += len(body)
        return body


class Question(Generic[A, B]):
    """A question that waits for its answers, mostly one; it may be kept and answered later."""

    def __init__(self, query: Any, service: Service[A, B], key: str, request: A, traffic: Traffic) -> None:
        self._query = query
        self._service = service
        self._key = key
        self._traffic = traffic
        self.request = request

    def answer(self, record: B, *, last: bool = True) -> None:
        """Send an answer; the last one ends the question."""
        body = self._traffic.counted(encode(record))
        try:
            self._query.reply(self._key, body, encoding=encoding_of(self._service.answer), attachment=checksum(body))
        except zenoh.ZError as error:
            log.warning("an answer on %s did not go out: %s", self._service.key, error)
        if last:
            self.drop()

    def refuse(self, reason: str) -> None:
        """Answer with an error and end the question."""
        _refuse(self._query, self._service.key, reason)

    def drop(self) -> None:
        """End the question without another answer."""
        self._query.drop()


class Answers(Generic[B]):
    """What comes to a question until it ends."""

    def __init__(self, take: Callable[[Any], B], key: str) -> None:
        """`take` makes a record of a reply, or raises NoAnswer."""
        self._take = take
        self._key = key
        self._replies: queue.SimpleQueue[Any] = queue.SimpleQueue()

    @property
    def handler(self) -> Any:
        """Takes what Zenoh has, on its own thread: another one in between would take milliseconds to start."""
        return zenoh.handlers.Callback(self._replies.put, drop=lambda: self._replies.put(None), indirect=False)

    def next(self, timeout_s: float, give_up: Callable[[], bool] = lambda: False) -> B:
        """The next answer. Waits in short stretches, so that signals are served and `give_up` is heard.

        Raises:
            NoAnswer: there is none in time or none to come, it was an error or was refused, or the asker gave up.
        """
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline and not give_up():
            try:
                reply = self._replies.get(timeout=STRETCH_S)
            except queue.Empty:
                continue
            if reply is None:
                break
            return self._take(reply)
        raise NoAnswer(f"{self._key}: nobody answers")


class Bus:
    """A session within the namespace of one run."""

    def __init__(self, session: Any, namespace: str, inbox: Inbox | None) -> None:
        """Callbacks are called by who takes from the `inbox`; None: by a thread of the bus."""
        self._session = session
        self._namespace = namespace
        self._declared: list[Any] = []  # zenoh undeclares what is no longer referenced
        self._inbox = inbox or Inbox()
        self._closed = False
        self.refused = 0
        self.traffic = Traffic()
        self._dispatcher: threading.Thread | None = None
        if inbox is None:
            self._dispatcher = threading.Thread(target=self._dispatch, name="bus", daemon=True)
            self._dispatcher.start()

    def close(self) -> None:
        """End the session; its thread hands nothing out any more."""
        self._session.close()
        self._closed = True
        if self._dispatcher is not None:
            self._inbox.put(lambda: None)  # so that it looks
            self._dispatcher.join()

    def publish(self, topic: Topic[A], record: A) -> None:
        """Send to all subscribers; who is not connected now never gets it."""
        put = partial(
            self._session.put,
            self._key(topic.key),
            encoding=encoding_of(topic.record),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        self._put(put, topic.key, record)

    def publisher(self, topic: Topic[A]) -> Callable[[A], None]:
        """Sends to all subscribers in other processes, and costs next to nothing as long as there are none."""
        declared = self._session.declare_publisher(
            self._key(topic.key),
            encoding=encoding_of(topic.record),
            congestion_control=zenoh.CongestionControl.BLOCK,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._declared.append(declared)

        def publish(record: A) -> None:
            if declared.matching_status.matching:
                self._put(declared.put, topic.key, record)

        return publish

    def _put(self, put: Callable[..., Any], key: str, record: Record) -> None:
        body = self.traffic.counted(encode(record))
        try:
            put(body, attachment=checksum(body))
        except zenoh.ZError as error:
            log.warning("a message on %s did not go out: %s", key, error)

    def subscribe(self, topic: Topic[A], on_record: Callable[[A], None]) -> None:
        """Call `on_record` with every valid message; it must be quick."""

        def take(sample: Any) -> None:
            try:
                record = decode(topic.record, str(sample.encoding), self._body(sample))
            except Refused as reason:
                self._refuse(topic.key, reason)
            else:
                on_record(record)

        self._declared.append(self._session.declare_subscriber(self._key(topic.key), self._in_order(take)))

    def serve(self, service: Service[A, B], on_question: Callable[[Question[A, B]], None]) -> None:
        """Call `on_question` with every valid question; it must be quick. Of a flood only `MOST_QUESTIONS` wait."""
        key = self._key(service.key)
        room = threading.Semaphore(MOST_QUESTIONS)

        def arrive(query: Any) -> None:
            if room.acquire(blocking=False):
                self._inbox.put(partial(take, query))
            else:
                query.drop()

        def take(query: Any) -> None:
            room.release()
            try:
                request = decode(service.request, str(query.encoding), self._body(query))
            except Refused as reason:
                self._refuse(service.key, reason)
                _refuse(query, service.key, str(reason))
            else:
                on_question(Question(query, service, key, request, self.traffic))

        handler = zenoh.handlers.Callback(arrive, indirect=False)
        self._declared.append(self._session.declare_queryable(key, handler, complete=True))

    def ask(
        self, service: Service[A, B], request: A, timeout_s: float, give_up: Callable[[], bool] = lambda: False
    ) -> B:
        """The one answer to a question; see `Answers.next`.

        Raises:
            NoAnswer: nobody answered in time, the answer was an error or was refused, or the asker gave up.
        """
        return self.ask_for_answers(service, request, timeout_s).next(timeout_s + GRACE_S, give_up)

    def ask_for_answers(self, service: Service[A, B], request: A, timeout_s: float) -> Answers[B]:
        """Ask a question that ends with its last answer, or after `timeout_s`.

        Raises:
            NoAnswer: it cannot be asked.
        """
        answers: Answers[B] = Answers(partial(self._answer, service), service.key)
        body = self.traffic.counted(encode(request))
        try:
            self._session.get(
                self._key(service.key),
                answers.handler,
                payload=body,
                attachment=checksum(body),
                encoding=encoding_of(service.request),
                timeout=timeout_s,
                consolidation=zenoh.ConsolidationMode.NONE,  # one process answers: nothing to hold an answer back for
            )
        except zenoh.ZError as error:
            raise NoAnswer(f"{service.key}: {error}") from None
        return answers

    def _answer(self, service: Service[A, B], reply: Any) -> B:
        if reply.ok is None:
            text = reply.err.payload.to_bytes()[:MAX_REASON_BYTES].decode(errors="replace")
            raise NoAnswer(f"{service.key}: {text}")
        try:
            return decode(service.answer, str(reply.ok.encoding), self._body(reply.ok))
        except Refused as reason:
            self._refuse(service.key, reason)
            raise NoAnswer(f"{service.key}: {reason}") from None

    def declare_alive(self, alive: Alive) -> None:
        """Hold a token that vanishes when this process dies."""
        self._declared.append(self._session.liveliness().declare_token(self._key(alive.key)))

    def watch_alive(self, key: str, on_change: Callable[[Alive, bool], None]) -> None:
        """Call `on_change` when a token comes (also those that are there already) or goes."""
        prefix = len(self._namespace) + 1

        def take(sample: Any) -> None:
            try:
                alive = Alive.parse(str(sample.key_expr)[prefix:])
            except ValueError as reason:
                self._refuse(key, reason)
            else:
                on_change(alive, sample.kind == zenoh.SampleKind.PUT)

        subscriber = self._session.liveliness().declare_subscriber(self._key(key), self._in_order(take), history=True)
        self._declared.append(subscriber)

    def connected(self) -> bool:
        """Whether the router is there right now."""
        return _is_linked(self._session)

    def _body(self, message: Any) -> bytes:
        """Of whatever has arrived.

        Raises:
            Refused: it is not as it was sent.
        """
        body = self.traffic.counted(b"" if message.payload is None else message.payload.to_bytes())
        if message.attachment is None or message.attachment.to_bytes() != checksum(body):
            raise Refused("its checksum is missing or wrong")
        return body

    def _in_order(self, take: Callable[[Any], None]) -> Any:
        return zenoh.handlers.Callback(lambda message: self._inbox.put(partial(take, message)), indirect=False)

    def _dispatch(self) -> None:
        while not self._closed:
            try:
                self._inbox.take(None)
            except Exception:
                log.exception("a message could not be handed on")  # the next one may be

    def _key(self, key: str) -> str:
        return absolute(self._namespace, key)

    def _refuse(self, key: str, reason: Exception) -> None:
        self.refused += 1
        if is_told(self.refused):
            log.warning("refused a message on %s (the %d.): %s", key, self.refused, reason)


def checksum(body: bytes) -> bytes:
    """What travels beside a body, so that one that is damaged on the way is not taken for another."""
    return zlib.crc32(body).to_bytes(4, "little")


def _refuse(query: Any, key: str, reason: str) -> None:
    try:
        query.reply_err(reason.encode())
    except zenoh.ZError as error:
        log.warning("a refusal on %s did not go out: %s", key, error)
    query.drop()


@contextmanager
def open_bus(
    endpoint: str,
    namespace: str,
    connect_timeout_s: float | None = None,
    inbox: Inbox | None = None,
    credentials: Credentials | None = None,
) -> Iterator[Bus]:
    """A client session of the router at `endpoint`, closed at the end; it reconnects by itself.

    Args:
        endpoint: for example `unixsock-stream//tmp/railctl-1/router`, or `tls/node7:7447`.
        namespace: the run's own key prefix.
        connect_timeout_s: how long to wait for the router; none waits for ever.
        inbox: where the caller takes what arrives, see `Bus`.
        credentials: what this process shows a router on another machine.

    Raises:
        NoAnswer: no router within `connect_timeout_s`.
    """
    try:
        session = _open(sessions.client(endpoint, connect_timeout_s, credentials))
    except zenoh.ZError as error:
        raise NoAnswer(f"no router at {endpoint}: {error}") from None
    bus = Bus(session, namespace, inbox)
    try:
        yield bus
    finally:
        bus.close()


@contextmanager
def open_router(endpoint: str, door: Door | None = None) -> Iterator[None]:
    """A router that listens on `endpoint`, at the door, if there is one, and nowhere else, until the end of the block.

    Raises:
        OSError: it cannot listen there.
    """
    places = endpoint if door is None else f"{endpoint} and {door.listen}"
    with _listening(sessions.router(endpoint, door), places):
        yield


@contextmanager
def open_relay(listen: str, host: str, credentials: Credentials) -> Iterator[Callable[[], bool]]:
    """A router that links others, at `listen`, to the host of a run, until the end of the block.

    Yields:
        Whether the host is linked right now.

    Raises:
        OSError: it cannot listen there.
    """
    with _listening(sessions.relay(listen, host, credentials), listen) as session:
        yield lambda: _is_linked(session)


@contextmanager
def _listening(settings: sessions.Plain, places: str) -> Iterator[Any]:
    """A session that others link to at these places; raises OSError if it cannot listen there."""
    try:
        session = _open(settings)
    except zenoh.ZError as error:
        raise OSError(f"cannot listen on {places}: {error}") from None
    try:
        yield session
    finally:
        session.close()


def _is_linked(session: Any) -> bool:
    """Whether the router of a client, or another router, is there right now."""
    return bool(session.info.routers_zid())


def _open(settings: sessions.Plain) -> Any:
    zenoh.init_log_from_env_or("error")
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
