"""The learner as its own actor: where nothing can run in parallel, acting elsewhere would only cost messages.

A run that has no actors is acted here. This one asks the desk as any actor does, and is answered as any question is.
"""

import time
from collections.abc import Callable, Mapping

from railctl.common.config import RunConfig
from railctl.common.levels.distributions import ANY
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.flat import Arrays
from railctl.common.policy.leased import LeasePlayer
from railctl.common.policy.player import chooser_of
from railctl.common.records.acting import Circumstances, Fragment, Lease, LeaseAnswer, LeaseRequest

NAME = "learner"
REQUEST = LeaseRequest.naming(NAME, NAME, ANY, ())


class InlineActor:
    """Acts one lease after another, and is the question for them.

    Attributes:
        lease: what it has to act; None: nothing.
        asks: its question is open.
    """

    def __init__(self, config: RunConfig, levels: LevelSupply, on_step: Callable[[], None] = lambda: None) -> None:
        """`on_step` is called as by `common.policy.player.Players`."""
        self._network = chooser_of(config)
        self._player = LeasePlayer(config, levels, self._network, on_step)
        self._loaded: int | None = None
        self.lease: Lease | None = None
        self.asks = False

    def answer(self, answer: LeaseAnswer, *, last: bool = True) -> None:
        """Take on a lease, if that is the answer."""
        self.lease, self.asks = answer.lease, not last

    def drop(self) -> None:
        """There will be no answer."""
        self.lease, self.asks = None, False

    def act(self, weights: Mapping[int, Arrays]) -> Fragment | None:
        """What comes of the lease, if there is one, with the weights of the version that it names."""
        lease, self.lease = self.lease, None
        if lease is None:
            return None
        begin = time.perf_counter()
        if self._loaded != lease.weights_version:
            self._network.load(weights[lease.weights_version])
            self._loaded = lease.weights_version
        course = self._player.act(lease)
        circumstances = Circumstances.made(actor=NAME, acting_s=time.perf_counter() - begin, waited_s=0.0)
        return Fragment.made(lease=lease, course=course, circumstances=circumstances)
