"""An actor's loop: ask for a lease, act it, publish the fragment, keep it until the learner has it in a snapshot."""

import logging
import threading
import time

import numpy as np
from numpy.typing import NDArray

from common.bus import NoAnswer
from common.levels.supply import supply_of
from common.policy.player import Acting, Players, chooser_of
from common.process import Fatal, ServiceContext
from common.records.acting import (
    Circumstances,
    Fragment,
    Lease,
    LeaseAnswer,
    LeaseRequest,
    Weights,
    WeightsRequest,
)
from common.records.heartbeats import ActorReport
from common.seeding import stream_key, training_malfunction_seed
from common.wire import keys

log = logging.getLogger(__name__)

ASK_TIMEOUT_S = 10.0
PUSH_PATIENCE_S = 0.2  # pushed weights are usually here before the lease that names them
RETRY_S = 0.2


class Stopped(Exception):  # noqa: N818  (not an error)
    """Somebody asked the actor to stop in the middle of an episode."""


class Shelf:
    """The newest pushed weights, by version."""

    def __init__(self, kept: int) -> None:
        self._kept = kept
        self._weights: dict[int, Weights] = {}
        self._changed = threading.Condition()

    def put(self, weights: Weights) -> None:
        """Take weights in, on any thread."""
        with self._changed:
            self._weights[weights.version] = weights
            for old in sorted(self._weights)[: -self._kept]:
                del self._weights[old]
            self._changed.notify_all()

    def get(self, version: int, patience_s: float) -> Weights | None:
        """The weights of a version, waiting for them a moment."""
        with self._changed:
            self._changed.wait_for(lambda: version in self._weights, patience_s)
            return self._weights.get(version)


class Actor:
    """One actor. Everything an episode depends on comes with its lease."""

    def __init__(self, context: ServiceContext, serves: str) -> None:
        self._context = context
        self._serves = serves
        self._kept: dict[tuple[int, int], Fragment] = {}  # by episode and fragment
        self._shelf = Shelf(context.config.lag + 2)
        self._levels = supply_of(context.config.world.levels, context.folder.path)
        self._stands_at: tuple[int, int] | None = None  # episode and steps that the last player's world is at
        self._network = chooser_of(context.config)
        self._players = Players(context.config, self._network, self._on_step)
        self._loaded: int | None = None
        self._acting = 0  # the episode
        self._acted = 0
        self._idle_since = time.perf_counter()

    def run(self) -> None:
        """Serve until asked to stop."""
        self._context.bus.subscribe(keys.WEIGHTS, self._shelf.put)
        while not self._context.stopping.asked:
            self._beat("waiting for work")
            answer = self._ask()
            if answer is None:
                self._context.stopping.wait(RETRY_S)
                continue
            self._settle(answer)
            if answer.lease is not None:
                try:
                    self._serve(answer.lease)
                except Stopped:
                    log.info("gave up episode %d: asked to stop", answer.lease.episode)

    def _ask(self) -> LeaseAnswer | None:
        request = LeaseRequest(
            actor=self._context.name,
            incarnation=self._context.incarnation,
            serves=self._serves,
            kept=np.array(sorted(self._kept), np.int64).reshape(-1, 2),
        )
        try:
            return self._context.bus.ask(keys.LEASE, request, ASK_TIMEOUT_S, self._stops_waiting)
        except NoAnswer as reason:
            log.debug("no lease: %s", reason)
            return None

    def _stops_waiting(self) -> bool:
        """Looked at while it waits for an answer, which takes long when the learner compiles."""
        self._beat("waiting for work")
        return self._context.stopping.asked

    def _settle(self, answer: LeaseAnswer) -> None:
        for unit in [unit for unit in self._kept if unit[0] < answer.safe_before]:
            del self._kept[unit]
        for episode, fragment in answer.missing.tolist():
            log.info("publishes episode %d, fragment %d again: the learner misses it", episode, fragment)
            self._publish(self._kept[episode, fragment])
        if len(answer.missing):
            self._context.stopping.wait(RETRY_S)  # what the learner refuses stays missing: no storm

    def _serve(self, lease: Lease) -> None:
        if not self._load(lease.weights_version):
            return  # the next question for work gives the lease back
        self._acting = lease.episode
        fragment = self._act(lease)
        self._kept[lease.unit] = fragment
        self._acted += fragment.course.over
        self._publish(fragment)
        self._idle_since = time.perf_counter()

    def _publish(self, fragment: Fragment) -> None:
        try:
            self._context.bus.publish(keys.FRAGMENTS, fragment)
        except ValueError as error:  # and so it would be again
            remedy = "have it come in shorter fragments, or with smaller observations"
            raise Fatal(f"episode {fragment.lease.episode} cannot be sent: {error}: {remedy}") from None

    def _load(self, version: int) -> bool:
        if self._loaded != version:
            weights = self._shelf.get(version, PUSH_PATIENCE_S) or self._pull(version)
            if weights is None:
                return False
            self._network.load(weights.tensors)
            self._loaded = version
        return True

    def _pull(self, version: int) -> Weights | None:
        try:
            return self._context.bus.ask(keys.PULL_WEIGHTS, WeightsRequest(version=version), ASK_TIMEOUT_S)
        except NoAnswer as reason:
            log.warning("no weights %d: %s", version, reason)
            return None

    def _act(self, lease: Lease) -> Fragment:
        begin = time.perf_counter()
        states = self._stand_at(lease)
        key = stream_key(self._context.config.seed, lease.episode, "explore")
        course = self._players.of(lease.level).advance(Acting(self._network, lease.epsilon, key), states, lease.steps)
        self._stands_at = (lease.episode, course.last_step)
        acting_s, waited_s = time.perf_counter() - begin, begin - self._idle_since
        circumstances = Circumstances(actor=self._context.name, acting_s=acting_s, waited_s=waited_s)
        return Fragment(lease=lease, course=course, circumstances=circumstances)

    def _stand_at(self, lease: Lease) -> NDArray[np.float32]:
        """Bring the world to where the lease goes on, unless it stands there; returns the trains' states [N, S]."""
        before, stands_at = lease.progressed, self._stands_at
        self._stands_at = None  # until all goes well
        if before is not None and stands_at == (lease.episode, before.first_step):
            return before.states.copy()
        level, player = self._levels.training(lease.level, lease.level_seed), self._players.of(lease.level)
        malfunction_seed = training_malfunction_seed(self._context.config.seed, lease.episode)
        if before is None:
            player.begin(level, malfunction_seed)
            return self._network.zero_state(level.n_trains)
        player.begin(level, malfunction_seed, before.actions, before.first_step)
        return before.states.copy()

    def _on_step(self) -> None:
        if self._context.stopping.asked:
            raise Stopped
        self._beat(f"acting episode {self._acting}")

    def _beat(self, state: str) -> None:
        self._context.heartbeat.beat(state, lambda: ActorReport(acted=self._acted, kept=len(self._kept)))
