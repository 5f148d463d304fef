"""An actor's loop: ask for leases, act one, publish the fragment, keep it until the learner has it in a snapshot.

A fragment that is published asks for the next lease, which comes as another answer to the same question. Once that has
ended, or nothing comes, the actor asks anew and says what it keeps.
"""

import logging
import time

from railctl.common.board import BoardReader
from railctl.common.bus import Answers, NoAnswer
from railctl.common.levels.supply import supply_of
from railctl.common.policy.flat import Arrays
from railctl.common.policy.leased import LeasePlayer
from railctl.common.policy.player import chooser_of
from railctl.common.process import Fatal, ServiceContext, Stopped
from railctl.common.records.acting import (
    Circumstances,
    Fragment,
    Lease,
    LeaseAnswer,
    LeaseRequest,
    WeightsRequest,
)
from railctl.common.records.heartbeats import ActorReport
from railctl.common.wire import keys

log = logging.getLogger(__name__)

ASK_TIMEOUT_S = 10.0
OPEN_S = 60.0  # of a question for leases: the learner ends it long before
RETRY_S = 0.2


class Actor:
    """One actor. Everything an episode depends on comes with its lease."""

    def __init__(self, context: ServiceContext, serves: str) -> None:
        self._context = context
        self._serves = serves
        self._kept: dict[tuple[int, int], Fragment] = {}  # by episode and fragment
        self._board = BoardReader(context.folder.board_file)
        levels = supply_of(context.config.world.levels, context.folder.path)
        self._network = chooser_of(context.config)
        self._player = LeasePlayer(context.config, levels, self._network, self._on_step)
        self._answers: Answers[LeaseAnswer] | None = None  # to the question that is open
        self._loaded: int | None = None
        self._acting = 0  # the episode
        self._acted = 0
        self._idle_since = time.perf_counter()

    def run(self) -> None:
        """Serve until asked to stop."""
        mix = self._context.config.mix
        self._player.get_ready(self._serves if self._serves in mix else next(iter(mix)))  # as the learner does now
        while not self._context.stopping.asked:
            self._beat("waiting for work")
            answer = self._next_answer() or self._ask()
            if answer is None:
                self._context.stopping.wait(RETRY_S)
                continue
            self._settle(answer)
            if answer.lease is not None:
                try:
                    self._serve(answer.lease)
                except Stopped:
                    log.info("gave up episode %d: asked to stop", answer.lease.episode)

    def _next_answer(self) -> LeaseAnswer | None:
        """To the question that is open, if there is one that has not ended."""
        try:
            return None if self._answers is None else self._answers.next(ASK_TIMEOUT_S, self._stops_waiting)
        except NoAnswer:
            return None

    def _ask(self) -> LeaseAnswer | None:
        """The first answer to a new question, in place of the open one."""
        request = LeaseRequest.naming(self._context.name, self._context.incarnation, self._serves, self._kept)
        self._loaded = None  # a learner that goes on from a snapshot may have come to other weights of the same number
        try:
            self._answers = self._context.bus.ask_for_answers(keys.LEASE, request, OPEN_S)
            return self._answers.next(ASK_TIMEOUT_S, self._stops_waiting)
        except NoAnswer as reason:
            log.debug("no lease: %s", reason)
            self._answers = None
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
            self._answers = None  # a new question gives the lease back
            return
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
            tensors = self._board.get(version) or self._pull(version)
            if tensors is None:
                return False
            self._network.load(tensors)
            self._loaded = version
        return True

    def _pull(self, version: int) -> Arrays | None:
        """From the learner itself: an actor on another machine does not see the board."""
        try:
            return self._context.bus.ask(keys.PULL_WEIGHTS, WeightsRequest(version=version), ASK_TIMEOUT_S).tensors
        except NoAnswer as reason:
            log.warning("no weights %d: %s", version, reason)
            return None

    def _act(self, lease: Lease) -> Fragment:
        begin = time.perf_counter()
        course = self._player.act(lease)
        acting_s, waited_s = time.perf_counter() - begin, begin - self._idle_since
        circumstances = Circumstances.made(actor=self._context.name, acting_s=acting_s, waited_s=waited_s)
        return Fragment.made(lease=lease, course=course, circumstances=circumstances)

    def _on_step(self) -> None:
        if self._context.stopping.asked:
            raise Stopped
        self._beat(f"acting episode {self._acting}")

    def _beat(self, state: str) -> None:
        self._context.heartbeat.beat(state, lambda: ActorReport(acted=self._acted, kept=len(self._kept)))
