"""An actor's loop: ask for a lease, act the episode, publish it, keep it until the learner has it in a snapshot."""

import logging
import threading
import time

import numpy as np

from common.bus import NoAnswer
from common.config import Serves
from common.levels.bank import bank_root
from common.levels.supply import LevelSupply
from common.policy.compiled import Twin
from common.policy.player import MAX_TRAINS, network_layout, player
from common.process import Place
from common.rail.play import Recording
from common.records import Episode, Lease, LeaseAnswer, LeaseRequest, Weights, WeightsRequest
from common.seeding import stream_key
from common.wire import keys

log = logging.getLogger(__name__)

ASK_TIMEOUT_S = 10.0
PUSH_PATIENCE_S = 0.2  # pushed weights are usually here before the lease that names them
RETRY_S = 0.2


class Stopped(Exception):  # noqa: N818  (not an error)
    """The actor was told to stop in the middle of an episode."""


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

    def __init__(self, place: Place, serves: Serves) -> None:
        self._place = place
        self._serves = serves
        self._kept: dict[int, Episode] = {}
        self._shelf = Shelf(place.config.lag + 2)
        self._levels = LevelSupply.from_folder(bank_root(place.folder.path.parent))
        self._play = player(place.config.engine, MAX_TRAINS, self._on_step)
        self._twin = Twin(network_layout(place.config.network))
        self._loaded: int | None = None
        self._acting = 0  # the episode
        self._acted = 0

    def run(self) -> None:
        """Serve until told to stop."""
        self._place.bus.subscribe(keys.WEIGHTS, self._shelf.put)
        while not self._place.stopping.asked:
            self._beat("waiting for work")
            answer = self._ask()
            if answer is None:
                self._place.stopping.wait(RETRY_S)
                continue
            self._settle(answer)
            if answer.lease is not None:
                try:
                    self._serve(answer.lease)
                except Stopped:
                    log.info("gave up episode %d: told to stop", answer.lease.episode)

    def _ask(self) -> LeaseAnswer | None:
        request = LeaseRequest(
            actor=self._place.name,
            incarnation=self._place.incarnation,
            serves=self._serves,
            kept=sorted(self._kept),
        )
        try:
            return self._place.bus.ask(keys.LEASE, request, ASK_TIMEOUT_S, lambda: self._place.stopping.asked)
        except NoAnswer as reason:
            log.debug("no lease: %s", reason)
            return None

    def _settle(self, answer: LeaseAnswer) -> None:
        for episode in [e for e in self._kept if e < answer.safe_before]:
            del self._kept[episode]
        for episode in answer.missing:
            log.info("publishes episode %d again: the learner misses it", episode)
            self._place.bus.publish(keys.EPISODES, self._kept[episode])
        if answer.missing:
            self._place.stopping.wait(RETRY_S)  # what the learner refuses stays missing: no storm

    def _serve(self, lease: Lease) -> None:
        if not self._load(lease.weights_version):
            return  # the next question for work gives the lease back
        self._acting = lease.episode
        episode = self._act(lease)
        self._kept[lease.episode] = episode
        self._acted += 1
        self._place.bus.publish(keys.EPISODES, episode)

    def _load(self, version: int) -> bool:
        if self._loaded != version:
            weights = self._shelf.get(version, PUSH_PATIENCE_S) or self._pull(version)
            if weights is None:
                return False
            self._twin.load(weights.tensors)
            self._loaded = version
        return True

    def _pull(self, version: int) -> Weights | None:
        try:
            return self._place.bus.ask(keys.PULL_WEIGHTS, WeightsRequest(version=version), ASK_TIMEOUT_S)
        except NoAnswer as reason:
            log.warning("no weights %d: %s", version, reason)
            return None

    def _act(self, lease: Lease) -> Episode:
        begin = time.perf_counter()
        level = self._levels.training(lease.level, lease.level_seed)
        key = stream_key(self._place.config.seed, lease.episode, "explore")
        recording = self._play(level, self._twin, lease.epsilon, key)
        return _episode(lease, recording, self._place.name, time.perf_counter() - begin)

    def _on_step(self) -> None:
        if self._place.stopping.asked:
            raise Stopped
        self._beat(f"acting episode {self._acting}")

    def _beat(self, state: str) -> None:
        self._place.heart.beat(state, lambda: {"acted": float(self._acted), "kept": float(len(self._kept))})


def _episode(lease: Lease, recording: Recording, actor: str, acting_s: float) -> Episode:
    return Episode(
        episode=lease.episode,
        fragment=0,
        first_step=0,
        over=True,
        level=lease.level,
        level_seed=lease.level_seed,
        level_hash=recording.level.content_hash,
        weights_version=lease.weights_version,
        actor=actor,
        acting_s=acting_s,
        max_steps=recording.level.max_steps,
        observations=np.array(recording.observations, np.float32).reshape(-1, recording.n_features),
        times=np.array(recording.times, np.int32),
        trains=np.array(recording.trains, np.int32),
        actions=np.array(recording.actions, np.int8),
        log_probabilities=np.zeros(len(recording.actions), np.float32),
        values=np.zeros(len(recording.actions), np.float32),
        rewards=np.array(recording.rewards, np.float32),
        arrived_at=recording.arrived_at,
        final_observations=recording.final_observations,
        states=np.zeros((len(recording.arrived_at), 0), np.float32),
    )
