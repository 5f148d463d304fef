"""Maps of the rails and the trains as one train sees them: an array [rows, columns, 23] of values in [0, 1].

Source: `GlobalObsForRailEnv` of flatland-rl 4.3.0, whose three arrays are one here, and whose numbers are scaled so
that 0 means that there is nothing:

| channel | meaning | value |
|---|---|---|
| 0-15 | the rails: whether a train that heads north (0-3), east, south, west may leave to each of them | 0 or 1 |
| 16 | the train itself: its heading, where it is, will depart from or has arrived | (heading + 1) / 4, north 0 |
| 17 | another train on the map: its heading | (heading + 1) / 4 |
| 18 | a train on the map: steps of malfunction left | steps / 50, at most 1 |
| 19 | a train on the map: its speed, in cells a step; under stock rules 0 if it stands | as it is |
| 20 | trains off the map that will depart from the cell | number / 5, at most 1 |
| 21 | the train's target | 0 or 1 |
| 22 | the target of any train that has not arrived, the train itself included | 0 or 1 |

The view is the same whatever the train's heading: row after row from north to south, each from west to east.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import DONE, NOTHING, NOWHERE, WAYS, Batch
from railctl.common.strict import Strict

CHANNELS: Final = 23
OWN_HEADING, OTHER_HEADING, MALFUNCTION, SPEED, READY, OWN_TARGET, TARGETS = range(16, CHANNELS)
LONG_MALFUNCTION_STEPS: Final = 50
MANY_TRAINS: Final = 5


class MapObservation(Strict):
    """What all observations on maps share."""

    @property
    def low(self) -> float:
        """The least that a value can be."""
        return 0.0

    @property
    def high(self) -> float:
        """The most that a value can be."""
        return 1.0


@bare_kernel
def draw_map(
    batch: Batch, slot: int, at: int, first_row: int, first_column: int, legacy: bool, canvas: NDArray[np.float32]
) -> None:
    """Draw what a train sees on `canvas` [rows, columns, 23], zeros so far; its first cell may lie off the grid."""
    codes, cells, trains = batch.codes[slot], batch.cells[slot], batch.trains[slot]
    rows, columns = canvas.shape[0], canvas.shape[1]
    for cell in range(batch.worlds[slot]["cells"]):
        row, column = int(cells[cell]["row"]) - first_row, int(cells[cell]["column"]) - first_column
        if not (0 <= row < rows and 0 <= column < columns):
            continue
        place = canvas[row, column]
        for heading in range(4):
            ways = codes[cell * 4 + heading] & WAYS
            for way in range(4):
                place[heading * 4 + way] = ways >> way & 1
        place[READY] = np.float32(min(int(cells[cell]["waiting"]), MANY_TRAINS) / MANY_TRAINS)
        other = int(cells[cell]["train"])
        if other != NOTHING:
            train = trains[other]
            if other != at:
                place[OTHER_HEADING] = np.float32(((train["config"] & 3) + 1) / 4)
            steps = min(int(train["malfunction"]), LONG_MALFUNCTION_STEPS)
            place[MALFUNCTION] = np.float32(steps / LONG_MALFUNCTION_STEPS)
            speed = train["full_speed"] if legacy else train["speed"]
            place[SPEED] = np.float32(speed / batch.worlds[slot]["unit"])
    for other in range(batch.worlds[slot]["trains"]):
        target = cells[trains[other]["target"]]
        row, column = int(target["row"]) - first_row, int(target["column"]) - first_column
        if 0 <= row < rows and 0 <= column < columns:
            if other == at:
                canvas[row, column, OWN_TARGET] = 1
            if trains[other]["state"] != DONE:
                canvas[row, column, TARGETS] = 1
    here = viewpoint(batch, slot, at)
    row, column = int(cells[here >> 2]["row"]) - first_row, int(cells[here >> 2]["column"]) - first_column
    if 0 <= row < rows and 0 <= column < columns:
        canvas[row, column, OWN_HEADING] = np.float32(((here & 3) + 1) / 4)


@bare_kernel
def viewpoint(batch: Batch, slot: int, at: int) -> int:
    """The configuration in which a train is, from which it will depart, or in which it arrived."""
    train = batch.trains[slot, at]
    if train["config"] != NOWHERE:
        return int(train["config"])
    return int(train["finish"] if train["state"] == DONE else train["start"])
