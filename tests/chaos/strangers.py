"""A process that has found the run's socket and keeps none of its rules."""

import json
import random
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import zenoh

from railctl.common.bus import Bus, NoAnswer, checksum, open_bus
from railctl.common.records.acting import Fragment, LeaseRequest
from railctl.common.records.heartbeats import Heartbeat
from railctl.common.wire import keys
from railctl.common.wire.codec import decode, encode, encoding_of

ASK_S = 5.0
ROUTER_S = 60.0  # one that was killed comes back sooner


class Stranger:
    """Listens to fragments and sends what it likes."""

    def __init__(self, session: zenoh.Session, endpoint: str, namespace: str, heard: deque[bytes]) -> None:
        self._session = session
        self._endpoint = endpoint
        self._namespace = namespace
        self._heard = heard
        key = f"{namespace}/{keys.FRAGMENTS.key}"
        others = zenoh.Locality.REMOTE  # its own garbage is nothing to forge messages from
        listen = session.declare_subscriber
        self._listens = listen(key, lambda sample: heard.append(sample.payload.to_bytes()), allowed_origin=others)

    def garbage(self, rng: random.Random) -> None:
        """Random bytes everywhere, with and without the right encoding."""
        for topic in (keys.FRAGMENTS, keys.HEARTBEATS, keys.EPISODE_ROWS, keys.CHECKPOINTS):
            self._put(topic.key, rng.randbytes(rng.randrange(2000)), encoding_of(topic.record))
        self._put("fragments", rng.randbytes(100), "text/plain")
        for service in (keys.LEASE, keys.PULL_WEIGHTS, keys.STATUS, keys.SCALE, keys.COMMAND_LEARNER):
            selector, body = f"{self._namespace}/{service.key}", rng.randbytes(50)
            told = {"encoding": encoding_of(service.request), "attachment": checksum(body), "timeout": 1}
            list(self._session.get(selector, payload=body, **told))

    def truncated(self, rng: random.Random) -> None:
        """A fragment that ends too soon, and one with a byte changed."""
        if heard := self._some(rng):
            self._fragment(heard[: rng.randrange(len(heard))])
            at = rng.randrange(len(heard))
            flipped = heard[:at] + bytes([heard[at] ^ (1 << rng.randrange(8))]) + heard[at + 1 :]
            self._put(keys.FRAGMENTS.key, flipped, encoding_of(Fragment), checksum(heard))

    def twice(self) -> None:
        """The last one again."""
        for _ in range(3):
            if self._heard:
                self._fragment(self._heard[-1])

    def replayed(self) -> None:
        """All that was heard so far."""
        for heard in list(self._heard):
            self._fragment(heard)

    def of_another_schema(self, rng: random.Random) -> None:
        """As an older version would send it."""
        if heard := self._some(rng):
            self._put(keys.FRAGMENTS.key, heard, encoding_of(Fragment).rpartition(".")[0] + ".1")

    def of_another_run(self, rng: random.Random) -> None:
        """Of a level that this run never had."""
        if heard := self._some(rng):
            fragment = decode(Fragment, encoding_of(Fragment), heard)
            self._send(fragment, level_seed=fragment.lease.level_seed + 1)

    def forged(self, rng: random.Random) -> None:
        """Episodes to come, brought by somebody who has leased nothing."""
        if heard := self._some(rng):
            fragment = decode(Fragment, encoding_of(Fragment), heard)
            if fragment.lease.progressed is None:
                for ahead in range(1, 4):
                    self._send(fragment, "stranger-0", episode=fragment.lease.episode + ahead)

    def forged_heartbeat(self, rng: random.Random) -> None:
        """Signs of life of processes that there are and that there are not, with another's pid."""
        for process, role in (("learner", "learner"), ("actor-easy-0", "actor"), ("evaluator", "evaluator")):
            beat = Heartbeat(process=process, role=role, pid=rng.randrange(2**31), state="finished", report=None)
            self._put(keys.HEARTBEATS.key, encode(beat), encoding_of(Heartbeat))

    def takes_a_lease(self) -> None:
        """Lives as an actor for a moment, and never brings what it has leased."""
        request = LeaseRequest(
            actor="stranger-0", incarnation="stranger", serves="any", kept=np.zeros((0, 2), np.int64)
        )
        try:
            with open_bus(self._endpoint, self._namespace, ASK_S) as bus:
                bus.declare_alive(keys.Alive("actor", "stranger-0", "stranger"))
                _ask(bus, request)
        except NoAnswer:
            return  # the router or the learner was just away

    def oversize(self) -> None:
        """More than anybody would take."""
        self._fragment(bytes(310_000_000))

    def _some(self, rng: random.Random) -> bytes:
        return rng.choice(self._heard) if self._heard else b""

    def _send(self, fragment: Fragment, actor: str = "actor-easy-0", **lease: int) -> None:
        circumstances = fragment.circumstances.model_copy(update={"actor": actor})
        changed = fragment.lease.model_copy(update=lease)
        self._fragment(encode(fragment.model_copy(update={"lease": changed, "circumstances": circumstances})))

    def _fragment(self, body: bytes) -> None:
        self._put(keys.FRAGMENTS.key, body, encoding_of(Fragment))

    def _put(self, key: str, body: bytes, encoding: str, beside: bytes | None = None) -> None:
        attachment = checksum(body) if beside is None else beside
        self._session.put(f"{self._namespace}/{key}", body, encoding=encoding, attachment=attachment)


def _ask(bus: Bus, request: LeaseRequest) -> None:
    for _ in range(3):  # the first comes before its token is seen
        bus.ask(keys.LEASE, request, ASK_S)


class Gone(Exception):  # noqa: N818  (the run is over)
    """Nobody listens where the run's router was."""


@contextmanager
def stranger(endpoint: str, namespace: str, heard: deque[bytes]) -> Iterator[Stranger]:
    """Somebody who listens in, adds to what was `heard` before, and reconnects as everybody does.

    Raises:
        Gone: there was no router.
    """
    timeout_ms = int(ROUTER_S * 1000)
    settings = {
        "mode": "client",
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": timeout_ms,
            "retry": {"period_init_ms": 20, "period_max_ms": 500},
        },
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    try:
        opened = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError:
        raise Gone from None
    with opened as session:
        yield Stranger(session, endpoint, namespace, heard)
