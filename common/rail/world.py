"""The interface that a batch of episodes runs through, whichever engine steps it."""

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.distributions import Bounds
from railctl.common.levels.level import Level

if TYPE_CHECKING:
    from railctl.common.rail.asking import Asking
    from railctl.common.rail.planning.judging import Teacher

N_ACTIONS = 5
DO_NOTHING, MOVE_LEFT, MOVE_FORWARD, MOVE_RIGHT, STOP_MOVING = range(N_ACTIONS)


class World(Protocol):
    """E slots; each is loaded with a level and steps on its own until its episode is over.

    Slots may hold different numbers of trains: arrays have room for `max_trains`, unused places are false or zero.
    """

    slots: int
    max_trains: int
    n_features: int

    def load(self, slot: int, level: Level, malfunction_seed: int = 0) -> None:
        """Start an episode of `level` in `slot`; the seed, of 32 bits, is that of its malfunctions, if it has any."""
        ...

    def deciding(self) -> NDArray[np.bool_]:
        """[E, N]: trains whose action matters now; all others follow the rails. False in slots that are over."""
        ...

    def observe(self, slot: int, train: int) -> NDArray[np.float32]:
        """[F]: the observation of a train that has not arrived."""
        ...

    def ask(self, slot: int) -> "Asking":
        """Begin to ask the slot's deciding trains, one after another, what they do; `step` does not depend on it."""
        ...

    def allowed(self, slot: int) -> NDArray[np.uint8]:
        """[N]: what each train would be allowed if it were asked before all others, a bit for each action.

        All actions for those that have arrived, and where there is no interlocking.
        """
        ...

    def advise(self, slot: int, train: int, allowed: int, teacher: "Teacher") -> int:
        """What a teacher would have a deciding train do that is allowed these actions, a bit each; -1 without a choice.

        See `common.rail.planning.judging`.
        """
        ...

    def step(self, actions: NDArray[np.int8]) -> NDArray[np.float32]:
        """One step of every slot that is not over.

        Args:
            actions: [E, N]; only those of deciding trains count.

        Returns:
            [E, N]: rewards; zero in slots that were over before.
        """
        ...

    def arrived(self) -> NDArray[np.bool_]:
        """[E, N]: trains that have reached their target (terminated)."""
        ...

    def over(self) -> NDArray[np.bool_]:
        """[E]: all trains arrived, or the step limit was reached (truncated); true where nothing was ever loaded."""
        ...

    def score(self, slot: int) -> float:
        """The score that flatland-rl 4.3.0 gives an episode, from 0 to 1, whatever trains are paid.

        NaN before its end, and under other rules.
        """
        ...


def check_level(level: Level, max_trains: int, bounds: Bounds | None) -> None:
    """Refuse a level for which there is no room.

    Raises:
        ValueError: it has more trains, or is larger than the bounds.
    """
    if level.n_trains > max_trains:
        raise ValueError(f"the level has {level.n_trains} trains, the world has room for {max_trains}")
    height, width = level.grid.shape
    if bounds is not None and (height > bounds.height or width > bounds.width):
        raise ValueError(f"the level has {height}x{width} cells, the world has room for {bounds.height}x{bounds.width}")
