"""Acting what a lease says: the same for whoever does it."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from railctl.common.config import RunConfig
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.compiled import Chooser
from railctl.common.policy.player import Acting, Players
from railctl.common.rail.planning.judging import Teacher
from railctl.common.records.acting import Lease
from railctl.common.records.course import Course
from railctl.common.seeding import stream_key, training_malfunction_seed


class LeasePlayer:
    """Acts the leases of a run, one after another; the next fragment of an episode goes on where the world stands."""

    def __init__(
        self, config: RunConfig, levels: LevelSupply, chooser: Chooser, on_step: Callable[[], None] = lambda: None
    ) -> None:
        """`chooser` has to hold the weights that a lease names; `on_step` is called as by `Players`."""
        self._seed = config.seed
        self._teaching = config.learning.teaching
        self._following = config.learning.learns_from_following
        self._levels = levels
        self._chooser = chooser
        self._players = Players(config, chooser, on_step)
        self._explores = (-1, 0)  # the last episode, and the key of its stream
        self._stands_at: tuple[int, int] | None = None  # episode and steps that the last player's world is at

    def get_ready(self, name: str) -> None:
        """Load or compile, with a level of a distribution, what the first lease would have to wait for."""
        self._players.of(name).begin(self._levels.training(name, 0))
        self._stands_at = None

    def act(self, lease: Lease) -> Course:
        """What happens under a lease."""
        states = self._stand_at(lease)
        acting = Acting(
            self._chooser,
            lease.epsilon,
            self._key(lease.episode),
            teacher=self._teacher(lease.episode),
            following=self._following,
        )
        course = self._players.of(lease.level).advance(acting, states, lease.steps)
        self._stands_at = (lease.episode, course.last_step)
        return course

    def _teacher(self, episode: int) -> Teacher | None:
        teaching = self._teaching
        return None if teaching is None else Teacher(*teaching, np.uint64(stream_key(self._seed, episode, "teacher")))

    def _key(self, episode: int) -> int:
        """Of the episode's stream of exploration, which its next fragment needs again."""
        if self._explores[0] != episode:
            self._explores = episode, stream_key(self._seed, episode, "explore")
        return self._explores[1]

    def _stand_at(self, lease: Lease) -> NDArray[np.float32]:
        """Bring the world to where the lease goes on, unless it stands there; returns the trains' states [N, S]."""
        before, stands_at = lease.progressed, self._stands_at
        self._stands_at = None  # until all goes well
        if before is not None and stands_at == (lease.episode, before.first_step):
            return before.states.copy()
        level, player = self._levels.training(lease.level, lease.level_seed), self._players.of(lease.level)
        malfunction_seed = training_malfunction_seed(self._seed, lease.episode)
        if before is None:
            player.begin(level, malfunction_seed)
            return self._chooser.zero_state(level.n_trains)
        player.begin(level, malfunction_seed, before.actions, before.first_step)
        return before.states.copy()
