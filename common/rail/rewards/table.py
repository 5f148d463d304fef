"""All rewards: settings, and compiled code. A new one is a module beside this, its test, and a line in each place."""

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Tag

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import Batch
from railctl.common.rail.rewards.delay import DelayReward, pay_delay
from railctl.common.rail.rewards.shaped import ShapedReward, pay_shaped
from railctl.common.rail.rewards.study import StudyReward, pay_study
from railctl.common.strict import by_kind

AnyReward = Annotated[
    Annotated[StudyReward, Tag("study")]
    | Annotated[DelayReward, Tag("delay")]
    | Annotated[ShapedReward, Tag("shaped")],
    by_kind("study"),
]

STUDY, DELAY, SHAPED = range(3)
NUMBERS = {"study": STUDY, "delay": DELAY, "shaped": SHAPED}


def weights_of(reward: Any) -> NDArray[np.float64]:
    """What `pay` is told of one of `AnyReward`: its number here, then its weights."""
    return np.array([NUMBERS[reward.kind], *reward.weights], np.float64)


@bare_kernel
def pay(batch: Batch, slot: int, rewards: NDArray[np.float32], weights: NDArray[np.float64]) -> None:
    """Fill `rewards` [N] of a world that has just stepped."""
    if weights[0] == STUDY:
        pay_study(batch, slot, rewards, weights[1:])
    elif weights[0] == DELAY:
        pay_delay(batch, slot, rewards, weights[1:])
    elif weights[0] == SHAPED:
        pay_shaped(batch, slot, rewards, weights[1:])
