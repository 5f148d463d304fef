"""What is done with a batch as a whole: loading a slot, and stepping all slots."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.rail.asking import unasked
from railctl.common.rail.compiled.arrays import DONE, NOTHING, NOWHERE, WAYS, Batch
from railctl.common.rail.compiled.decisions import decides
from railctl.common.rail.compiled.malfunctions import begin
from railctl.common.rail.compiled.paths import lay_rails, measure, number_cells
from railctl.common.rail.compiled.step import start, step
from railctl.common.rail.interlocking.signals import OFF
from railctl.common.rail.rewards.table import pay
from railctl.common.rail.world import MOVE_LEFT, MOVE_RIGHT

LOADED, OFF_GRID, NO_ROOM, ASTRAY, TOO_FAR = range(5)


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
    starts: NDArray[np.int32],
    targets: NDArray[np.int32],
    orders: NDArray[np.int32],
    unit: int,
    max_steps: int,
    legacy: bool,
    mode: int,
    deciding: NDArray[np.bool_],
    arrived: NDArray[np.bool_],
    over: NDArray[np.bool_],
) -> tuple[int, int]:
    """Put a level into a slot, and survey it.

    Args:
        batch: of which the slot is overwritten.
        slot: which one.
        grid: [H, W].
        starts: [N, 3], row, column, heading.
        targets: [N, 2], row, column.
        orders: [N, 4], see `common.rail.orders`.
        unit: as there.
        max_steps: the step limit.
        legacy: the rules.
        mode: of decisions.
        deciding: [E, N], overwritten in the slot.
        arrived: [E, N], overwritten in the slot.
        over: [E], overwritten in the slot.

    Returns:
        LOADED, and the number of cells; or OFF_GRID; or NO_ROOM, and the number of cells that there must be room for;
        these change nothing. Or ASTRAY, and the first train whose target has no rails; or TOO_FAR, if some place is
        farther from a target than can be told: then the slot is over.
    """
    height, width = grid.shape
    numbers, places = np.empty((height + 2) * (width + 2), np.int32), np.empty(height * width + 1, np.int32)
    count = number_cells(grid, starts, targets, numbers, places)
    if count == NOTHING:
        return OFF_GRID, 0
    if count > batch.cells.shape[1]:
        return NO_ROOM, count
    world = batch.worlds[slot]
    world["trains"] = len(starts)
    world["cells"] = count
    world["unit"] = unit
    world["max_steps"] = max_steps
    world["over"] = True
    world["breaks"] = False
    lay_rails(batch, slot, grid, numbers, places[:count])
    astray = place_trains(batch, slot, width + 2, numbers, starts, targets, orders)
    if astray != NOTHING:
        over[slot], deciding[slot], arrived[slot] = True, False, False
        return ASTRAY, astray
    if not measure(batch, slot):
        over[slot], deciding[slot], arrived[slot] = True, False, False
        return TOO_FAR, 0
    start(batch, slot, legacy)
    survey(batch, slot, mode, deciding, arrived, over)
    return LOADED, count


@bare_kernel
def place_trains(
    batch: Batch,
    slot: int,
    line: int,
    numbers: NDArray[np.int32],
    starts: NDArray[np.int32],
    targets: NDArray[np.int32],
    orders: NDArray[np.int32],
) -> int:
    """Give the trains of a slot their orders; the first whose target has no rails, or NOTHING.

    `numbers` are those of `number_cells`, whose lines are so long.
    """
    unit = batch.worlds[slot]["unit"]
    for at in range(len(starts)):
        train = batch.trains[slot, at]
        target = numbers[(targets[at, 0] + 1) * line + targets[at, 1] + 1]
        speed, departure, headings = orders[at, 0], orders[at, 1], orders[at, 2]
        ways = 0
        for heading in range(4):
            if batch.codes[slot, target * 4 + heading] & WAYS:
                ways |= 1 << heading
        if headings:
            ways &= headings
        if ways == 0:
            return at
        train["start"] = numbers[(starts[at, 0] + 1) * line + starts[at, 1] + 1] * 4 + starts[at, 2]
        train["target"] = target
        train["target_ways"] = ways
        train["full_speed"] = speed
        train["departure"] = departure
        train["latest_arrival"] = orders[at, 3]
        train["steps_per_cell"] = unit // speed
        train["time_per_cell"] = 1.0 / (speed / unit)
    return NOTHING


@bare_kernel
def break_from_now_on(
    batch: Batch, slot: int, chance: float, shortest: int, longest: int, draw: int, goes_on: bool
) -> None:
    """Let the trains of a slot break down whose generators are given; see `common.rail.compiled.malfunctions`."""
    world = batch.worlds[slot]
    world["breaks"] = True
    world["chance"] = chance
    world["shortest"] = shortest
    world["longest"] = longest
    world["draw"] = draw
    begin(world, batch.uniforms[slot], batch.later[slot], batch.known[slot], goes_on)


@bare_kernel
def bind(trains: NDArray[np.void], deciding: NDArray[np.bool_]) -> None:
    """Note of a step's trains [N] which of those that decided to leave their cell could not, having broken down say."""
    for at in range(len(trains)):
        train = trains[at]
        if train["config"] != train["before"]:
            train["bound"] = NOTHING
        elif deciding[at] and train["config"] != NOWHERE and MOVE_LEFT <= train["action"] <= MOVE_RIGHT:
            train["bound"] = train["action"]


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
    weights: NDArray[np.float64],
    interlocking: int,
    obey: bool,
) -> None:
    """One step of every slot that is not over; trains that need not decide do as `unasked` says unless all `obey`.

    `weights` are those of `common.rail.rewards.table`.
    """
    for slot in range(len(batch.worlds)):
        rewards[slot] = 0
        if over[slot]:
            continue
        trains, codes = batch.trains[slot], batch.codes[slot]
        for at in range(batch.worlds[slot]["trains"]):
            own = obey or deciding[slot, at]
            trains[at]["action"] = actions[slot, at] if own else unasked(codes, trains[at]["config"], interlocking)
        step(batch, slot, legacy)
        if not legacy and interlocking != OFF:
            bind(trains[: batch.worlds[slot]["trains"]], deciding[slot])
        pay(batch, slot, rewards[slot], weights)
        survey(batch, slot, mode, deciding, arrived, over)
