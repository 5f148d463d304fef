"""A sum of the rewards that people give to trains on their way, each with a weight.

| weight | what it is multiplied with, for a train and a step |
|---|---|
| step | 1 until the train has arrived, so that it is 0 on the step of its arrival |
| arrival | 1 on the step on which the train arrives |
| all_arrived | 1 for every train on the step on which the last one arrives |
| progress | cells by which the shortest path to the target got shorter in the step; negative on a detour |
| deadlock | 1 on the step on which the train first is in a deadlock (`common.rail.rewards.deadlocks`) |
| delay | the reward `delay` (`common.rail.rewards.delay`), which is 0 or negative |

A penalty is a negative weight, but for `delay`. As it stands, the reward is the study's.
"""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from railctl.common.kernel import kernel
from railctl.common.rail.compiled.arrays import DONE, NOWHERE, UNREACHED, Batch
from railctl.common.rail.rewards.deadlocks import find_deadlocks
from railctl.common.rail.rewards.delay import payment
from railctl.common.strict import Strict

Weight = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]


class ShapedReward(Strict):
    """Weights of what a train is paid for; see the module."""

    kind: Literal["shaped"] = "shaped"
    step: Weight = -1.0
    arrival: Weight = 0.0
    all_arrived: Weight = 1.0
    progress: Weight = 0.0
    deadlock: Weight = 0.0
    delay: Weight = 0.0

    @property
    def floor(self) -> float:
        """The least reward a step that a train can get for ever; everything but `step` is paid once, or evens out."""
        return min(self.step, 0.0)

    @property
    def weights(self) -> tuple[float, ...]:
        """In the order in which `pay_shaped` takes them."""
        return self.step, self.arrival, self.all_arrived, self.progress, self.deadlock, self.delay


@kernel
def pay_shaped(batch: Batch, slot: int, rewards: NDArray[np.float32], weights: NDArray[np.float64]) -> None:
    """Fill `rewards` [N] of a world that has just stepped; the sum is of float64."""
    step, arrival, all_arrived = weights[0], weights[1], weights[2]
    progress, deadlock, delay = weights[3], weights[4], weights[5]
    world, trains = batch.worlds[slot], batch.trains[slot]
    count = world["trains"]
    stuck = np.zeros(count, np.bool_)
    if deadlock != 0:
        find_deadlocks(batch, slot, stuck)
    for at in range(count):
        train = trains[at]
        has_arrived = train["state"] == DONE
        paid = 0.0 if has_arrived else step
        if has_arrived and train["arrived_at"] == world["time"]:
            paid += arrival
        if world["all_arrived"]:
            paid += all_arrived
        if progress != 0:
            paid += progress * gained(batch, slot, at)
        if stuck[at] and not train["stuck"]:
            train["stuck"] = True
            paid += deadlock
        if delay != 0:
            paid += delay * payment(batch, slot, at)
        rewards[at] = paid


@kernel
def gained(batch: Batch, slot: int, at: int) -> int:
    """Cells by which a train came nearer to its target in the last step; 0 if there is no way, or was none."""
    train, distances = batch.trains[slot, at], batch.distances[slot, at]
    world = batch.worlds[slot]
    if train["state"] == DONE and train["arrived_at"] != world["time"]:
        return 0
    start = int(train["start"])
    before = start if train["before"] == NOWHERE else int(train["before"])
    now = int(train["finish"]) if train["state"] == DONE else int(train["config"])
    now = start if now == NOWHERE else now
    if distances[before] == UNREACHED or distances[now] == UNREACHED:
        return 0
    return int(distances[before]) - int(distances[now])
