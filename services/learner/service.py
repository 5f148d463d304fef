"""The learner's loop: messages in, leases and weights out, one episode trained at a time, strictly in order."""

import logging
import queue
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from common.bus import Question
from common.checkpoint import Tensors
from common.config import RunConfig
from common.process import Fatal, ServiceContext
from common.rail.normalise import N_FEATURES
from common.records import (
    CheckpointFile,
    CheckpointNotice,
    CheckpointRequest,
    CommandAnswer,
    Empty,
    Episode,
    EpisodeRow,
    EpisodeRows,
    HistoryRequest,
    LearnerCommand,
    Lease,
    LeaseAnswer,
    LeaseRequest,
    Weights,
    WeightsRequest,
)
from common.seeding import training_level_seed
from common.wire import keys
from common.wire.keys import Alive
from services.learner.archive import KEPT_SNAPSHOTS, Archive
from services.learner.learning import build_trainer, learning_of
from services.learner.ledger import Ledger, Unit
from services.learner.memory import Memory, take_memory
from services.learner.opened import OpenEpisode
from services.learner.replay.transitions import check_order
from services.learner.schedule import difficulties
from services.learner.telemetry import Telemetry

log = logging.getLogger(__name__)

LONG_POLL_S = 2.0  # an answer without work goes out after this
RATE_WINDOW_S = 30.0
HISTORY_CHUNK = 1000


@dataclass
class Parked:
    """A question for work that waits."""

    question: Question[LeaseRequest, LeaseAnswer]
    deadline: float


class Learner:
    """The learner of a run, from its newest snapshot to the last episode."""

    def __init__(self, context: ServiceContext) -> None:
        self._context = context
        self._config: RunConfig = context.config
        self._archive = Archive(context.folder, context.config)
        try:
            self._trainer = build_trainer(self._config.rule, learning_of(self._config))
        except ValueError as error:
            raise Fatal(str(error)) from None
        self._settled = self._trainer.weights()
        self._weights: dict[int, Weights] = {}
        self._open = OpenEpisode()
        snapshot = self._archive.resume()
        if snapshot is not None:
            self._restore(snapshot)
        self._ledger = Ledger(
            difficulties(self._config),
            self._config.lag,
            trained=self._archive.snapshot,
            fragment=len(self._open.fragments),
            version=self._archive.version,
        )
        self._steps = sum(row.steps for row in self._archive.rows)  # of all trained episodes
        self._telemetry = Telemetry(context.folder, self._archive.snapshot)
        self._inbox: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._parked: dict[str, Parked] = {}
        self._paused = context.folder.paused_file.exists()
        self._pace: deque[tuple[float, int]] = deque([(time.monotonic(), 0)])
        self._rejected = 0

    def _restore(self, snapshot: Tensors) -> None:
        try:
            memory = take_memory(snapshot)
            if memory.settled.keys() != self._settled.keys():
                raise ValueError(f"tensor settled/{min(self._settled)} is missing")  # noqa: TRY301  (said as the others)
            self._trainer.restore(snapshot, memory.opened)
        except ValueError as error:
            raise Fatal(f"the newest snapshot does not fit this version: {error}: use the one that wrote it") from None
        self._weights = {version: Weights(version=version, tensors=older) for version, older in memory.older.items()}
        self._settled = memory.settled
        self._open = OpenEpisode(memory.opened)

    def run(self) -> None:
        """Serve until told to stop; then leave a snapshot that holds everything."""
        self._publish_weights()
        self._open_doors()
        self._announce_checkpoints()
        log.info("goes on after %d of %d episodes", self._ledger.trained, self._ledger.total)
        while not self._context.stopping.asked:
            self._take_messages(wait_s=0.1)
            while not (self._paused or self._context.stopping.asked):
                episode = self._ledger.next_ready()
                if episode is None:
                    break
                self._train_if_right(episode)
                self._answer_parked()
                self._take_messages(wait_s=0.0)
            self._answer_parked()
            self._beat()
        if self._archive.version < self._ledger.version:
            self._save_snapshot()

    def close(self) -> None:
        """Close the files."""
        self._archive.close()
        self._telemetry.close()

    def _open_doors(self) -> None:
        bus = self._context.bus
        bus.watch_alive(keys.ALL_ALIVE, lambda alive, there: self._inbox.put(partial(self._on_alive, alive, there)))
        bus.subscribe(keys.EPISODES, lambda episode: self._inbox.put(partial(self._on_episode, episode)))
        bus.serve(keys.LEASE, lambda question: self._inbox.put(partial(self._on_lease, question)))
        bus.serve(keys.PULL_WEIGHTS, lambda question: self._inbox.put(partial(self._on_pull_weights, question)))
        bus.serve(keys.LIST_CHECKPOINTS, lambda question: self._inbox.put(partial(self._on_list, question)))
        bus.serve(keys.PULL_CHECKPOINT, lambda question: self._inbox.put(partial(self._on_pull_checkpoint, question)))
        bus.serve(keys.EPISODE_HISTORY, lambda question: self._inbox.put(partial(self._on_history, question)))
        bus.serve(keys.COMMAND_LEARNER, lambda question: self._inbox.put(partial(self._on_command, question)))

    def _take_messages(self, wait_s: float) -> None:
        try:
            self._inbox.get(timeout=wait_s)() if wait_s else self._inbox.get_nowait()()
            while True:
                self._inbox.get_nowait()()
        except queue.Empty:
            pass

    # What arrives

    def _on_alive(self, alive: Alive, there: bool) -> None:
        if alive.role != "actor":
            return
        log.info("%s %s %s", alive.process, alive.incarnation, "came" if there else "is gone")
        if there:
            self._ledger.actor_came(alive.incarnation)
        else:
            self._ledger.actor_gone(alive.incarnation)
            if parked := self._parked.pop(alive.incarnation, None):
                parked.question.drop()

    def _on_episode(self, episode: Episode) -> None:
        if (reason := self._wrong(episode)) is not None:
            self._refuse(episode, reason)
        elif not self._ledger.receive(episode):
            log.info("dropped a duplicate of episode %d from %s", episode.episode, episode.actor)

    def _refuse(self, episode: Episode, reason: str) -> None:
        self._rejected += 1
        where = f"episode {episode.episode}, fragment {episode.fragment}"
        log.warning("refused %s of %s: %s", where, episode.actor, reason)

    def _wrong(self, episode: Episode) -> str | None:
        if episode.episode >= self._ledger.total:
            return f"this run has {self._ledger.total} episodes"
        lease = self._lease((episode.episode, episode.fragment))
        if (reason := _differs(episode, lease, "level", "level_seed")) is not None:
            return reason
        if episode.observations.shape[1] != N_FEATURES:
            return f"observations have {episode.observations.shape[1]} features, the network takes {N_FEATURES}"
        try:
            check_order(episode)
        except ValueError as reason:
            return str(reason)
        return None

    def _wrong_now(self, episode: Episode) -> str | None:
        """What shows only when all that comes before is trained."""
        lease = self._lease((episode.episode, episode.fragment))
        if (reason := _differs(episode, lease, "weights_version", "first_step")) is not None:
            return reason
        if lease.steps is None and not episode.over:
            return "it is not over, its lease covers all of it"
        if lease.steps is not None and not (len(episode.rewards) == lease.steps or episode.over):
            return f"it has {len(episode.rewards)} steps, its lease {lease.steps}"
        return None

    def _on_lease(self, question: Question[LeaseRequest, LeaseAnswer]) -> None:
        request = question.request
        if old := self._parked.pop(request.incarnation, None):
            old.question.drop()
        kept = [(episode, fragment) for episode, fragment in request.kept.tolist()]
        missing = self._ledger.missing(request.incarnation, kept)
        if missing:
            question.answer(self._lease_answer(None, missing))
        else:
            self._parked[request.incarnation] = Parked(question, time.monotonic() + LONG_POLL_S)

    def _on_pull_weights(self, question: Question[WeightsRequest, Weights]) -> None:
        weights = self._weights.get(question.request.version)
        if weights is None:
            question.refuse(f"weights {question.request.version} are not kept: there are {sorted(self._weights)}")
        else:
            question.answer(weights)

    def _on_list(self, question: Question[Empty, CheckpointNotice]) -> None:
        question.answer(self._notice())

    def _on_pull_checkpoint(self, question: Question[CheckpointRequest, CheckpointFile]) -> None:
        episode = question.request.episode
        content = self._archive.checkpoint_content(episode)
        if content is None:
            question.refuse(f"no checkpoint after episode {episode}")
        else:
            question.answer(CheckpointFile(episode=episode, content=content))

    def _on_history(self, question: Question[HistoryRequest, EpisodeRows]) -> None:
        first, rows = question.request.first, self._archive.rows
        question.answer(EpisodeRows(rows=rows[first : first + HISTORY_CHUNK], total=len(rows)))

    def _on_command(self, question: Question[LearnerCommand, CommandAnswer]) -> None:
        verb = question.request.verb
        if verb == "pause":
            self._context.folder.paused_file.touch()
            self._paused = True
            text = f"paused after episode {self._ledger.trained}; railctl resume goes on"
        elif verb == "resume":
            self._context.folder.paused_file.unlink(missing_ok=True)
            self._paused = False
            text = f"goes on after episode {self._ledger.trained}"
        else:
            self._save_snapshot()
            text = f"wrote {self._save_checkpoint()}"
        log.info("%s: %s", verb, text)
        self._beat(now=True)
        question.answer(CommandAnswer(done=True, text=text))

    # What goes out

    def _train_if_right(self, episode: Episode) -> None:
        if (reason := self._wrong_now(episode)) is not None:
            self._ledger.discard()
            self._refuse(episode, reason)
        else:
            self._train(episode)

    def _train(self, episode: Episode) -> None:
        with self._telemetry.learning():
            told = self._trainer.train(episode)
        self._ledger.mark_trained()
        self._open.fragments.append(episode)
        with self._telemetry.publishing():
            self._publish_weights()
        self._telemetry.note(told)
        if not episode.over:
            self._beat()
            return
        trained = self._ledger.trained
        self._settled = self._weights[self._ledger.version].tensors
        row = self._row(episode)
        self._archive.append(row)
        self._telemetry.end_episode(row.episode, acting_s=self._open.acting_s, waited_s=self._open.waited_s)
        self._open = OpenEpisode()
        self._steps += row.steps
        self._context.bus.publish(keys.EPISODE_ROWS, row)
        self._pace.append((time.monotonic(), row.steps))
        if trained % self._config.cluster.snapshot_every_episodes == 0 or self._ledger.finished:
            self._save_snapshot()
        if trained % self._config.evaluation.every_episodes == 0 or self._ledger.finished:
            self._save_checkpoint()
        self._beat(now=self._ledger.finished)

    def _publish_weights(self) -> None:
        version = self._ledger.version
        weights = Weights(version=version, tensors=self._trainer.weights())
        self._weights[version] = weights
        self._weights.pop(version - self._config.lag - 2, None)
        self._context.bus.publish(keys.WEIGHTS, weights)

    def _answer_parked(self) -> None:
        now = time.monotonic()
        for incarnation, parked in list(self._parked.items()):
            granted = None if self._paused else self._ledger.grant(incarnation, parked.question.request.serves)
            if granted is not None or now >= parked.deadline:
                del self._parked[incarnation]
                lease = None if granted is None else self._lease(granted)
                parked.question.answer(self._lease_answer(lease, []))

    def _lease(self, unit: Unit) -> Lease:
        episode, fragment = unit
        opened = self._open if fragment > 0 and episode == self._ledger.trained else OpenEpisode()
        every = self._config.learning.steps_a_fragment
        return Lease(
            episode=episode,
            level=self._difficulty(episode),
            level_seed=training_level_seed(self._config.seed, episode),
            weights_version=self._ledger.weights_version(episode),
            epsilon=self._epsilon(episode),
            steps=None if every is None else every - (self._steps + opened.steps) % every,
            progressed=opened.progressed,
        )

    def _lease_answer(self, lease: Lease | None, missing: list[Unit]) -> LeaseAnswer:
        return LeaseAnswer(
            lease=lease,
            missing=np.array(missing, np.int64).reshape(-1, 2),
            safe_before=self._archive.snapshot,
            finished=self._ledger.finished,
        )

    def _epsilon(self, episode: int) -> float:
        """The share of random actions."""
        return self._config.learning.epsilon(episode, self._config.episodes)

    def _difficulty(self, episode: int) -> str:
        return self._ledger.difficulties[episode]

    def _row(self, episode: Episode) -> EpisodeRow:
        return EpisodeRow(
            episode=episode.episode,
            level=episode.level,
            seed=episode.level_seed,
            normalised_return=self._open.reward / (len(episode.arrived_at) * episode.max_steps),
            arrived=int((episode.arrived_at >= 0).sum()),
            trains=len(episode.arrived_at),
            steps=self._open.steps,
            decisions=self._open.decisions,
            epsilon=self._epsilon(episode.episode),
            weights_version=self._open.weights_version,
            digest=self._open.digest,
            actor=episode.actor,
            acting_s=round(self._open.acting_s, 4),
            trained_unix_s=round(time.time(), 3),
        )

    def _save_snapshot(self) -> None:
        kept = 1 if self._ledger.finished else KEPT_SNAPSHOTS
        trained = self._ledger.trained
        versions = range(max(0, trained - self._config.lag), trained)
        older = {version: self._weights[version].tensors for version in versions}
        state = self._trainer.state() | Memory(older, self._settled, self._open.fragments).tensors()
        self._archive.save_snapshot(state, trained, self._ledger.version, kept)

    def _save_checkpoint(self) -> str:
        path = self._archive.save_checkpoint(self._settled, self._ledger.trained, self._ledger.version)
        self._announce_checkpoints()
        return str(path)

    def _announce_checkpoints(self) -> None:
        self._context.bus.publish(keys.CHECKPOINTS, self._notice())

    def _notice(self) -> CheckpointNotice:
        return CheckpointNotice(
            episodes=self._archive.checkpoints(self._ledger.trained), finished=self._ledger.finished
        )

    def _beat(self, *, now: bool = False) -> None:
        state = "finished" if self._ledger.finished else "paused" if self._paused else "training"
        self._context.heartbeat.beat(state, self._counters, now=now)

    def _counters(self) -> dict[str, float]:
        horizon = time.monotonic() - RATE_WINDOW_S
        while len(self._pace) > 1 and self._pace[0][0] < horizon:
            self._pace.popleft()
        elapsed = max(time.monotonic() - self._pace[0][0], 1e-3)
        recent = [row.normalised_return for row in self._archive.rows[-100:]]
        counters: dict[str, Any] = {
            "done": self._ledger.trained,
            "leased": self._ledger.leased,
            "version": self._ledger.version,
            "snapshot": self._archive.snapshot,
            "checkpoints": len(self._archive.checkpoints(self._ledger.trained)),
            "episodes_per_s": (len(self._pace) - 1) / elapsed,
            "steps_per_s": sum(steps for _, steps in list(self._pace)[1:]) / elapsed,
            "refused": self._context.bus.refused + self._rejected,
            "duplicates": self._ledger.duplicates,
            "reissued": self._ledger.reissued,
        }
        if recent:
            counters["return_last_100"] = sum(recent) / len(recent)
        if self._archive.exact_until is not None:
            counters["exact_until"] = self._archive.exact_until
        counters |= {f"waiting.{level}": count for level, count in self._ledger.waiting().items()}
        return {name: float(value) for name, value in counters.items()}


def _differs(episode: Episode, lease: Lease, *fields: str) -> str | None:
    for field in fields:
        if getattr(episode, field) != getattr(lease, field):
            return f"{field} is {getattr(episode, field)}, its lease says {getattr(lease, field)}"
    return None
