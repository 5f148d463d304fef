"""The evaluator's loop: follow the checkpoints, score each once, publish rows with history."""

import logging
import threading
import time
from functools import partial

from railctl.common import checkpoint
from railctl.common.bus import NoAnswer, Question
from railctl.common.checkpoint import CheckpointError
from railctl.common.levels.supply import supply_of
from railctl.common.policy.player import Players, chooser_of
from railctl.common.process import Fatal, ServiceContext
from railctl.common.records.checkpoints import CheckpointFile, CheckpointNotice, CheckpointRequest
from railctl.common.records.control import Empty
from railctl.common.records.heartbeats import EvaluatorReport
from railctl.common.records.rows import EvaluationRow, EvaluationRows, HistoryRequest
from railctl.common.rows import DamagedRows, RowFile
from railctl.common.wire import keys
from railctl.services.evaluator.runner import Policy, evaluate, greedy, sampled

log = logging.getLogger(__name__)

ASK_TIMEOUT_S = 10.0
LOOK_S = 0.2
ASK_EVERY_S = 5.0  # announcements can get lost; asking cannot
HISTORY_CHUNK = 1000


class Stopped(Exception):  # noqa: N818  (not an error)
    """Somebody asked the evaluator to stop in the middle of an evaluation."""


class Evaluator:
    """The evaluator of a run. Its row file says what is done, so it can be killed at any time."""

    def __init__(self, context: ServiceContext) -> None:
        self._context = context
        self._config = context.config
        try:
            self._file = RowFile(context.folder.evaluations_file, EvaluationRow)
        except DamagedRows as error:
            raise Fatal(str(error)) from None
        self._done = {(row.episode, row.level) for row in self._file.read()}
        self._announced = threading.Event()
        self._levels = supply_of(context.config.world.levels, context.folder.path)
        self._network = chooser_of(context.config)
        self._players = Players(context.config, self._network, self._on_step)

    def run(self) -> None:
        """Serve until asked to stop."""
        self._context.bus.subscribe(keys.CHECKPOINTS, lambda _notice: self._announced.set())
        self._context.bus.serve(keys.EVALUATION_HISTORY, self._on_history)
        waited_s = ASK_EVERY_S
        while not self._context.stopping.asked:
            self._beat("waiting for checkpoints")
            if self._announced.is_set() or waited_s >= ASK_EVERY_S:
                self._announced.clear()
                waited_s = 0.0
                self._evaluate_new()
            self._context.stopping.wait(LOOK_S)
            waited_s += LOOK_S

    def _on_history(self, question: Question[HistoryRequest, EvaluationRows]) -> None:
        rows = list(self._file.read(question.request.first, HISTORY_CHUNK))
        question.answer(EvaluationRows(rows=rows, total=self._file.count))

    def _evaluate_new(self) -> None:
        try:
            notice: CheckpointNotice = self._context.bus.ask(keys.LIST_CHECKPOINTS, Empty(), ASK_TIMEOUT_S, self._stops)
            for episode in notice.episodes:
                if not all((episode, level) in self._done for level in self._config.mix):
                    self._evaluate(episode)
        except NoAnswer as reason:
            log.debug("no checkpoints: %s", reason)
        except Stopped:
            log.info("asked to stop in the middle of an evaluation")

    def _evaluate(self, episode: int) -> None:
        pulled: CheckpointFile = self._context.bus.ask(
            keys.PULL_CHECKPOINT, CheckpointRequest(episode=episode), ASK_TIMEOUT_S, self._stops
        )
        try:
            tensors, metadata = checkpoint.from_bytes(pulled.content, "checkpoint", source=f"checkpoint {episode}")
        except CheckpointError as error:
            raise Fatal(str(error)) from None
        self._network.load(tensors)
        for level in self._config.mix:
            if (episode, level) not in self._done:
                row = self._score(episode, level, metadata["digest"])
                self._file.append(row)
                self._file.sync()
                self._done.add((episode, level))
                self._context.bus.publish(keys.EVALUATION_ROWS, row)
                self._beat("evaluating", now=True)  # the run may be complete
                log.info("checkpoint %d on %s: %.4f", episode, level, row.normalised_return)

    def _score(self, episode: int, level: str, weights_digest: str) -> EvaluationRow:
        begin = time.perf_counter()
        levels = self._config.evaluation.levels
        score = evaluate(self._policy(level), map(partial(self._levels.evaluation, level), range(levels)))
        return EvaluationRow(
            episode=episode,
            level=level,
            mode=self._config.evaluation.mode,
            levels=levels,
            normalised_return=score.mean_return,
            arrived_share=score.arrived_share,
            all_arrived_share=score.all_arrived_share,
            mean_steps=score.mean_steps,
            score=score.mean_score,
            weights_digest=weights_digest,
            evaluated_unix_s=round(time.time(), 3),
            evaluating_s=round(time.perf_counter() - begin, 3),
        )

    def _policy(self, level: str) -> Policy:
        player = self._players.of(level)
        if self._config.evaluation.mode == "greedy":
            return greedy(player, self._network)
        return sampled(player, self._network, self._config.seed)

    def _stops(self) -> bool:
        """Looked at while it waits for an answer, which takes long when the learner compiles."""
        self._beat("waiting for checkpoints")
        return self._context.stopping.asked

    def _on_step(self) -> None:
        if self._context.stopping.asked:
            raise Stopped
        self._beat("evaluating")

    def _beat(self, state: str, *, now: bool = False) -> None:
        self._context.heartbeat.beat(state, lambda: EvaluatorReport(evaluations=self._file.count), now=now)
