"""What is done with a batch as a whole: loading a slot, and stepping all slots."""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.rail.compiled.arrays import DONE, WAYS, Batch
from common.rail.compiled.decisions import decides
from common.rail.compiled.paths import lay_rails, measure
from common.rail.compiled.step import start, step
from common.rail.world import MOVE_FORWARD


@bare_kernel
def survey(
    batch: Batch,
    slot: int,
    mode: int,
    deciding: NDArray[np.bool_],
    arrived: NDArray[np.bool_],
    over: NDArray[np.bool_],
) -> None:
    """Fill in what has become of a slot: [E, N], [E, N] and [E]."""
    world, trains, codes = batch.worlds[slot], batch.trains[slot], batch.codes[slot]
    over[slot] = world["over"]
    deciding[slot] = False
    arrived[slot] = False
    for at in range(world["trains"]):
        arrived[slot, at] = trains[at]["state"] == DONE
        deciding[slot, at] = not world["over"] and decides(trains[at], codes, world["unit"], mode)


@kernel
def load(
    batch: Batch,
    slot: int,
    grid: NDArray[np.uint16],
    numbers: NDArray[np.int32],
    count: int,
    starts: NDArray[np.int32],
    targets: NDArray[np.int32],
    speeds: NDArray[np.int32],
    departures: NDArray[np.int32],
    unit: int,
    max_steps: int,
    legacy: bool,
    mode: int,
    deciding: NDArray[np.bool_],
    arrived: NDArray[np.bool_],
    over: NDArray[np.bool_],
) -> int:
    """Put a level into a slot, and survey it; the first train whose target has no rails, or -1.

    `numbers` [H, W] numbers the cells of `grid` [H, W], `count` in all. `starts` [N, 3] are row, column, heading;
    `targets` [N, 3] row, column, and a bit for each heading that counts, 0 for all that the rails allow; `speeds` [N]
    are in 1 / `unit` cells a step; `departures` [N] are times.
    """
    world = batch.worlds[slot]
    world["trains"] = len(starts)
    world["cells"] = count
    world["unit"] = unit
    world["max_steps"] = max_steps
    lay_rails(batch, slot, grid, numbers, count)
    for at in range(len(starts)):
        train = batch.trains[slot, at]
        target = numbers[targets[at, 0], targets[at, 1]]
        ways = 0
        for heading in range(4):
            if batch.codes[slot, target * 4 + heading] & WAYS:
                ways |= 1 << heading
        if targets[at, 2]:
            ways &= targets[at, 2]
        if ways == 0:
            return at
        train["start"] = numbers[starts[at, 0], starts[at, 1]] * 4 + starts[at, 2]
        train["target"] = target
        train["target_ways"] = ways
        train["full_speed"] = speeds[at]
        train["departure"] = departures[at]
        train["steps_per_cell"] = unit // speeds[at]
        train["time_per_cell"] = 1.0 / (speeds[at] / unit)
    measure(batch, slot)
    start(batch, slot, legacy)
    survey(batch, slot, mode, deciding, arrived, over)
    return -1


@bare_kernel
def step_all(
    batch: Batch,
    actions: NDArray[np.int8],
    rewards: NDArray[np.float32],
    deciding: NDArray[np.bool_],
    arrived: NDArray[np.bool_],
    over: NDArray[np.bool_],
    mode: int,
    legacy: bool,
    obey: bool,
) -> None:
    """One step of every slot that is not over; trains that need not decide move forward unless all `obey`."""
    for slot in range(len(batch.worlds)):
        rewards[slot] = 0
        if over[slot]:
            continue
        trains = batch.trains[slot]
        for at in range(batch.worlds[slot]["trains"]):
            own = obey or deciding[slot, at]
            trains[at]["action"] = actions[slot, at] if own else MOVE_FORWARD
        step(batch, slot, rewards[slot], legacy)
        survey(batch, slot, mode, deciding, arrived, over)
