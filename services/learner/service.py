"""The learner's loop: messages in, leases and weights out, one episode trained at a time, strictly in order."""

import logging
import time
from collections import deque
from typing import TYPE_CHECKING

from railctl.common.board import Board
from railctl.common.bus import Question
from railctl.common.checkpoint import Tensors
from railctl.common.inbox import Inbox
from railctl.common.levels.supply import supply_of
from railctl.common.process import Fatal, ServiceContext, Stopped
from railctl.common.records.acting import Fragment, LeaseAnswer, LeaseRequest, Weights, WeightsRequest
from railctl.common.records.checkpoints import CheckpointFile, CheckpointNotice, CheckpointRequest
from railctl.common.records.control import CommandAnswer, Empty, LearnerCommand
from railctl.common.records.heartbeats import LearnerReport
from railctl.common.records.rows import HISTORY_PATIENCE_S, EpisodeRows, HistoryRequest
from railctl.common.sparing import is_told
from railctl.common.wire import keys
from railctl.common.wire.keys import Alive
from railctl.services.learner.account import Account, is_due, row_of
from railctl.services.learner.archive import KEPT_SNAPSHOTS, Archive
from railctl.services.learner.desk import Desk, Reply, Start
from railctl.services.learner.inline_actor import NAME, REQUEST, InlineActor
from railctl.services.learner.learning import build_trainer, check_metrics, learning_of
from railctl.services.learner.memory import Memory, take_memory
from railctl.services.learner.opened import OpenEpisode
from railctl.services.learner.schedule import Schedule
from railctl.services.learner.start import demonstrations_of, start_of
from railctl.services.learner.telemetry import Telemetry

if TYPE_CHECKING:
    from railctl.common.policy.flat import Arrays

log = logging.getLogger(__name__)

LeaseQuestion = Question[LeaseRequest, LeaseAnswer] | InlineActor

TURN_S = 0.1
HISTORY_CHUNK = 1000
MOST_ASKED = 1000  # for history, at a time
STORY_SHOWN = 30


class Learner:
    """The learner of a run, from its newest snapshot to the last episode."""

    def __init__(self, context: ServiceContext, inbox: Inbox) -> None:
        """What the context's bus brings arrives in the `inbox`."""
        self._context = context
        self._inbox = inbox
        self._config = context.config
        beat_on = context.heartbeat.beat_on
        self._archive = Archive(context.folder, context.config, beat_on)
        snapshot = self._archive.resume()
        try:
            start = start_of(context.folder, self._config)
            # A snapshot's replay holds what is left of them.
            demonstrations = demonstrations_of(context.folder, self._config) if snapshot is None else ()
            self._trainer = build_trainer(self._config.rule, learning_of(self._config, start, demonstrations))
        except ValueError as error:
            raise Fatal(str(error)) from None
        self._settled = self._trainer.weights()  # after the last whole episode
        self._weights: dict[int, Arrays] = {}
        memory = Memory({}, self._settled, []) if snapshot is None else self._restore(snapshot)
        self._board = Board(context.folder.board_file, self._trainer.weights(), self._kept_versions)
        self._account = Account(self._archive.rows.read(), time.monotonic())
        self._desk: Desk[LeaseQuestion] = Desk(
            Schedule.of(self._config),
            self._config.world.n_features,
            Start(self._archive.snapshot, self._archive.version, self._account.steps, memory.opened),
        )
        self._asked: deque[tuple[Question[HistoryRequest, EpisodeRows], float]] = deque()  # for history, until when
        self._actors: set[str] = set()  # the incarnations of those that live
        self._inline: InlineActor | None = None  # made when it is needed
        self._acts = False
        self._telemetry = Telemetry(context.folder, self._archive.snapshot, context.bus.traffic, memory.noted, beat_on)
        self._ended: OpenEpisode | None = None  # trained, but its row and files are still due
        self._paused = context.folder.paused_file.exists()

    def _restore(self, snapshot: Tensors) -> Memory:
        """Take on a snapshot; returns what it holds besides the trainer's state."""
        try:
            memory = take_memory(snapshot)
            if memory.settled.keys() != self._settled.keys():
                raise ValueError(f"tensor settled/{min(self._settled)} is missing")  # noqa: TRY301  (said as the others)
            self._trainer.restore(snapshot, memory.opened)
        except ValueError as error:
            raise Fatal(f"the newest snapshot does not fit this version: {error}: use the one that wrote it") from None
        self._weights = dict(memory.older)
        self._settled = memory.settled
        return memory

    def run(self) -> None:
        """Serve until asked to stop; then leave a snapshot that holds everything."""
        self.open()
        try:
            while not self._context.stopping.asked:
                self.turn(TURN_S)
        except Exception:
            log.exception("what happened before: %s", "; ".join(list(self._desk.story)[-STORY_SHOWN:]))
            raise
        if self._archive.version < self._desk.ledger.version:
            self._save_snapshot()

    def open(self) -> None:
        """Publish what there is, and listen."""
        for version, tensors in self._weights.items():
            self._board.put(version, tensors)
        self._publish_weights()
        bus = self._context.bus
        self._publish_fragment = bus.publisher(keys.FRAGMENTS)
        self._act_if_nobody_shall()
        bus.watch_alive(keys.ALL_ALIVE, self._on_alive)
        bus.subscribe(keys.FRAGMENTS, self._on_fragment)
        bus.serve(keys.LEASE, self._on_lease)
        bus.serve(keys.PULL_WEIGHTS, self._on_pull_weights)
        bus.serve(keys.LIST_CHECKPOINTS, self._on_list)
        bus.serve(keys.PULL_CHECKPOINT, self._on_pull_checkpoint)
        bus.serve(keys.EPISODE_HISTORY, self._on_history)
        bus.serve(keys.COMMAND_LEARNER, self._on_command)
        self._announce_checkpoints()
        log.info("goes on after %d of %d episodes", self._desk.ledger.trained, self._desk.ledger.total)

    def turn(self, wait_s: float = 0.0) -> None:
        """Handle what has arrived, train what is ready, answer who waits."""
        self._inbox.take(0.0 if self._acts_next or self._asked else wait_s)
        while not (self._paused or self._context.stopping.asked):
            fragment = self._desk.next_ready() or self._act()
            if fragment is None:
                break
            if self._config.lag and not self._acts:
                self._give()  # what may be acted before this is trained, elsewhere
            self._train(fragment)
            self._inbox.take()
            self._give()
            self._end_episode()
            self._tell_history()
            self._beat()
        self._give()
        self._tell_history()
        self._beat()

    def close(self) -> None:
        """Close the files."""
        self._board.close()
        self._archive.close()
        self._telemetry.close()

    # What arrives

    def _on_alive(self, alive: Alive, there: bool) -> None:
        if alive.role != "actor":
            return
        log.info("%s %s %s", alive.process, alive.incarnation, "came" if there else "is gone")
        if there:
            if self._acts:
                self._acts = False
                self._send(self._desk.actor_gone(NAME))
            self._actors.add(alive.incarnation)
            self._desk.actor_came(alive.process, alive.incarnation)
        else:
            self._actors.discard(alive.incarnation)
            self._send(self._desk.actor_gone(alive.incarnation))
            self._act_if_nobody_shall()

    def _on_fragment(self, fragment: Fragment) -> None:
        if (refusal := self._desk.arrive(fragment)) is not None and is_told(self._desk.refused):
            log.warning("%s (the %d.)", refusal, self._desk.refused)

    def _on_lease(self, question: Question[LeaseRequest, LeaseAnswer]) -> None:
        self._send(self._desk.ask(question, question.request, time.monotonic()))

    def _on_pull_weights(self, question: Question[WeightsRequest, Weights]) -> None:
        version = question.request.version
        if version in self._weights:
            question.answer(Weights(version=version, tensors=dict(self._weights[version])))
        else:
            question.refuse(f"weights {version} are not kept: there are {sorted(self._weights)}")

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
        if len(self._asked) < MOST_ASKED:
            self._asked.append((question, time.monotonic() + HISTORY_PATIENCE_S))
        else:
            question.drop()

    def _tell_history(self) -> None:
        """To one who asks for it, between episodes: reading takes longer than some of them, and training goes on."""
        while self._asked:
            question, until = self._asked.popleft()
            if time.monotonic() > until:
                question.drop()
                continue
            rows = self._archive.rows
            question.answer(EpisodeRows(rows=list(rows.read(question.request.first, HISTORY_CHUNK)), total=rows.count))
            return

    def _on_command(self, question: Question[LearnerCommand, CommandAnswer]) -> None:
        self._end_episode()  # a snapshot counts on its row
        verb, trained = question.request.verb, self._desk.ledger.trained
        if verb == "pause":
            self._context.folder.paused_file.touch()
            self._paused = True
            text = f"paused after episode {trained}; railctl resume goes on"
        elif verb == "resume":
            self._context.folder.paused_file.unlink(missing_ok=True)
            self._paused = False
            text = f"goes on after episode {trained}"
        else:
            self._save_snapshot()
            text = f"wrote {self._save_checkpoint()}"
        log.info("%s: %s", verb, text)
        self._beat(now=True)
        question.answer(CommandAnswer(done=True, text=text))

    # What is acted here

    def _act_if_nobody_shall(self) -> None:
        """Be the actor of a run that has none and shall have none, until one comes."""
        if self._acts or self._actors or self._context.folder.wants_actors():
            return
        if self._inline is None:
            levels = supply_of(self._config.world.levels, self._context.folder.path)
            self._inline = InlineActor(self._config, levels, self._on_step)
        self._acts = True
        self._desk.actor_came(NAME, NAME)

    @property
    def _acts_next(self) -> bool:
        return self._inline is not None and self._inline.lease is not None and not self._paused

    def _act(self) -> Fragment | None:
        """Act what is leased to the learner itself; returns what is to be trained now."""
        try:
            fragment = None if self._inline is None else self._inline.act(self._weights)
        except Stopped:
            return None
        if fragment is None:
            return None
        self._publish_fragment(fragment)
        self._on_fragment(fragment)
        return self._desk.next_ready()

    def _on_step(self) -> None:
        if self._context.stopping.asked:
            raise Stopped
        self._beat()

    # What goes out

    def _train(self, fragment: Fragment) -> None:
        with self._telemetry.learning():
            try:
                metrics = self._trainer.train(fragment)
                check_metrics(metrics)
            except FloatingPointError as error:
                raise Fatal(f"episode {fragment.lease.episode}: {error}") from None
        episode = self._desk.mark_trained()
        with self._telemetry.publishing():
            self._publish_weights()
        self._telemetry.note(metrics)
        self._ended = episode

    def _end_episode(self) -> None:
        """Write what is due of an episode that is over; actors have their leases by then, and act meanwhile."""
        if self._ended is not None:
            episode, self._ended = self._ended, None
            self._record(episode)

    def _record(self, episode: OpenEpisode) -> None:
        ledger = self._desk.ledger
        self._settled = self._weights[ledger.version]
        row = row_of(episode, ledger.version, time.time())
        self._archive.append(row)
        self._telemetry.end_episode(
            row.episode,
            acting_s=episode.acting_s,
            waited_s=episode.waited_s,
            staleness=episode.staleness(ledger.version),
        )
        self._account.end_episode(row, time.monotonic())
        self._context.bus.publish(keys.EPISODE_ROWS, row)
        is_scored = is_due(ledger.trained, self._config.evaluation.every_episodes, finished=ledger.finished)
        # A free run would not come to the weights of a checkpoint once more.
        must_last = is_scored and self._config.is_free
        if must_last or is_due(ledger.trained, self._config.cluster.snapshot_every_episodes, finished=ledger.finished):
            self._save_snapshot()
        if is_scored:
            self._save_checkpoint()
        self._beat(now=ledger.finished)

    def _publish_weights(self) -> None:
        version = self._desk.ledger.version
        weights = self._weights[version] = self._trainer.weights()
        self._weights.pop(version - self._kept_versions, None)
        try:
            self._board.put(version, weights)
        except ValueError as error:
            raise Fatal(f"{error}: training has diverged, lower the learning rate") from None

    @property
    def _kept_versions(self) -> int:
        """How many of the weights: those that leases name, and one more for an actor that is late."""
        return self._config.most_ahead + 2

    def _give(self) -> None:
        now = time.monotonic()
        if self._inline is not None and self._acts and not self._inline.asks:
            self._inline.asks = True
            self._send(self._desk.ask(self._inline, REQUEST, now))
        self._send(self._desk.give(now, paused=self._paused))

    def _send(self, replies: list[Reply[LeaseQuestion]]) -> None:
        for question, answer, last in replies:
            if answer is None:
                question.drop()
            else:
                question.answer(answer, last=last)

    def _save_snapshot(self) -> None:
        ledger = self._desk.ledger
        versions = range(ledger.weights_version(ledger.trained), ledger.version)  # that leases to come may name
        older = {version: self._weights[version] for version in versions}
        memory = Memory(older, self._settled, self._desk.opened.fragments, self._telemetry.noted())
        kept = 1 if ledger.finished else KEPT_SNAPSHOTS
        state = self._trainer.state() | memory.tensors()
        self._telemetry.sync()  # what is in a snapshot is not told again
        self._archive.save_snapshot(state, ledger.trained, ledger.version, kept)
        self._desk.safe_before = ledger.trained

    def _save_checkpoint(self) -> str:
        ledger = self._desk.ledger
        path = self._archive.save_checkpoint(self._settled, ledger.trained, ledger.version)
        self._announce_checkpoints()
        return str(path)

    def _announce_checkpoints(self) -> None:
        self._context.bus.publish(keys.CHECKPOINTS, self._notice())

    def _notice(self) -> CheckpointNotice:
        ledger = self._desk.ledger
        return CheckpointNotice(episodes=self._archive.checkpoints(ledger.trained), finished=ledger.finished)

    def _beat(self, *, now: bool = False) -> None:
        state = "finished" if self._desk.ledger.finished else "paused" if self._paused else "training"
        self._context.heartbeat.beat(state, self._report, now=now)

    def _report(self) -> LearnerReport:
        ledger = self._desk.ledger
        episodes_per_s, steps_per_s = self._account.pace(time.monotonic())
        return LearnerReport(
            done=ledger.trained,
            leased=ledger.leased,
            waiting={} if self._acts else ledger.waiting(),  # for an actor
            weights_version=ledger.version,
            snapshot=self._archive.snapshot,
            checkpoints=len(self._archive.checkpoints(ledger.trained)),
            return_last_100=self._account.mean_return,
            staleness_last_100=self._account.mean_staleness,
            episodes_per_s=episodes_per_s,
            steps_per_s=steps_per_s,
            refused=self._context.bus.refused + self._desk.refused,
            duplicates=ledger.duplicates,
            reissued=ledger.reissued,
            exact_until=self._archive.exact_until,
        )
