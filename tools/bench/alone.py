"""A run in one process, without a message: what a curve costs where nobody has to talk.

Desk, trainer and players are those of the cluster, so the episodes are the same to the bit. There is no bus, no codec
and no disk, and one core does everything in turn.
"""

import time
from collections.abc import Iterator
from typing import NamedTuple

from railctl.common.config import RunConfig
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.flat import Arrays
from railctl.services.learner.desk import Desk
from railctl.services.learner.inline_actor import NAME, REQUEST, InlineActor
from railctl.services.learner.learning import build_trainer, learning_of
from railctl.services.learner.schedule import Schedule


class Trained(NamedTuple):
    """An episode as it was trained."""

    digest: str
    steps: int
    decisions: int
    at_s: float  # since the process was ready


class Alone:
    """Actor and learner of a run in one."""

    def __init__(self, config: RunConfig, levels: LevelSupply | None = None) -> None:
        """Levels come from the generator, unless a supply is given."""
        self._config = config
        self._actor = InlineActor(config, levels or LevelSupply(config.world.levels))
        self._trainer = build_trainer(config.rule, learning_of(config))
        self._desk: Desk[InlineActor] = Desk(Schedule.of(config), config.world.n_features)
        self._desk.actor_came(NAME, NAME)
        self._weights = {0: self._trainer.weights()}

    def run(self) -> list[Trained]:
        """All episodes, in the order in which they were trained."""
        return list(self.train())

    @property
    def version(self) -> int:
        """How many fragments have been trained."""
        return self._desk.ledger.version

    def weights(self) -> Arrays:
        """Those after the last fragment."""
        return self._weights[self.version]

    def train(self) -> Iterator[Trained]:
        """One episode after another, each when it is trained."""
        begun = time.perf_counter()
        self._desk.ask(self._actor, REQUEST, 0.0)
        while not self._desk.ledger.finished:
            for actor, answer, last in self._desk.give(0.0):
                if answer is not None:
                    actor.answer(answer, last=last)
            if (fragment := self._actor.act(self._weights)) is not None:
                self._desk.arrive(fragment)
            while (ready := self._desk.next_ready()) is not None:
                self._trainer.train(ready)
                episode = self._desk.mark_trained()
                version = self._desk.ledger.version
                self._weights[version] = self._trainer.weights()
                self._weights.pop(version - self._config.most_ahead - 2, None)
                if episode is not None:
                    seconds = time.perf_counter() - begun
                    yield Trained(episode.digest, episode.steps, episode.decisions, seconds)
