"""The reward of flatland-rl 4.3.0, which counts delays, and the score that it makes of an episode.

Source: `DefaultRewards` of flatland-rl 4.3.0 with its default parameters, without stops on the way. It pays once:

| when | how it ended | reward |
|---|---|---|
| on its arrival | it has arrived | min(0, latest arrival - time of arrival) |
| at the end of the episode | it is on the map | min(0, latest arrival - time - travel time) |
| at the end of the episode | it never departed | -travel time |

The travel time is that of the shortest path at full speed, rounded up, where the path counts the train's own cell, too;
it is 0 for a train without a way. A level without a timetable has its step limit as the latest arrival.
"""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import DONE, NOWHERE, UNREACHED, Batch
from railctl.common.strict import Strict


class DelayReward(Strict):
    """Minus the steps that a train is late: on arrival, or at the end of the episode, as far as can be told then."""

    kind: Literal["delay"] = "delay"

    @property
    def floor(self) -> float:
        """The least reward a step that a train can get for ever."""
        return 0.0

    @property
    def weights(self) -> tuple[float, ...]:
        """What `pay_delay` is told: nothing."""
        return ()


@bare_kernel
def pay_delay(batch: Batch, slot: int, rewards: NDArray[np.float32], weights: NDArray[np.float64]) -> None:  # noqa: ARG001
    """Fill `rewards` [N] of a world that has just stepped."""
    for at in range(batch.worlds[slot]["trains"]):
        rewards[at] = payment(batch, slot, at)


@bare_kernel
def payment(batch: Batch, slot: int, at: int) -> int:
    """What a train is paid for the step that its world has just taken."""
    world, train = batch.worlds[slot], batch.trains[slot, at]
    arrives = train["state"] == DONE and train["arrived_at"] == world["time"]
    return delay(batch, slot, at) if arrives or (world["over"] and train["state"] != DONE) else 0


@bare_kernel
def delay(batch: Batch, slot: int, at: int) -> int:
    """What a train that has arrived was paid; what one that has not would be paid if the episode were over."""
    world, train = batch.worlds[slot], batch.trains[slot, at]
    latest = int(train["latest_arrival"])
    if train["state"] == DONE:
        return min(0, latest - int(train["arrived_at"]))
    config = int(train["config"])
    left = int(batch.distances[slot, at, train["start"] if config == NOWHERE else config])
    speed, unit = int(train["full_speed"]), int(world["unit"])
    travel_time = 0 if left == UNREACHED else ((left + 1) * unit + speed - 1) // speed
    return -travel_time if config == NOWHERE else min(0, latest - int(world["time"]) - travel_time)


@bare_kernel
def score(batch: Batch, slot: int, legacy: bool) -> float:
    """4.3.0's normalised score of the episode of a slot, from 0 to 1; NaN under other rules, and before its end.

    It is 1 + (sum over trains of max(-step limit, delay)) / (trains * step limit).
    """
    world: Any = batch.worlds[slot]
    n_trains, most = int(world["trains"]), int(world["max_steps"])
    if legacy or not world["over"] or n_trains == 0:
        return np.nan
    total = 0
    for at in range(n_trains):
        total += max(-most, delay(batch, slot, at))
    return total / (most * n_trains) + 1
