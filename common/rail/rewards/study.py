"""The study's reward: -1 a step until arrival, 0 from then on; 1 more for all on the step that the last train arrives.

Source: "Deep Reinforcement Learning in the Flatland Multi-Agent Environment" (2021), and flatland 2.2.2.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import DONE, Batch
from railctl.common.strict import Strict


class StudyReward(Strict):
    """-1 a step for every train that has not arrived, and 1 for all trains on the step that the last one arrives."""

    kind: Literal["study"] = "study"

    @property
    def floor(self) -> float:
        """The least reward a step that a train can get for ever."""
        return -1.0

    @property
    def weights(self) -> tuple[float, ...]:
        """What `pay_study` is told: nothing."""
        return ()


@bare_kernel
def pay_study(batch: Batch, slot: int, rewards: NDArray[np.float32], weights: NDArray[np.float64]) -> None:  # noqa: ARG001
    """Fill `rewards` [N] of a world that has just stepped."""
    world, trains = batch.worlds[slot], batch.trains[slot]
    all_arrived = world["all_arrived"]
    for at in range(world["trains"]):
        rewards[at] = (0 if trains[at]["state"] == DONE else -1) + (1 if all_arrived else 0)
