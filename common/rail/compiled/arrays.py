"""The state of a batch of worlds as flat arrays with a leading slot axis.

A world numbers the cells that carry rails (and those that a train could be sent to), row after row; a configuration
is `cell * 4 + heading`, heading 0 north, 1 east, 2 south, 3 west. Everything that only the rails determine stands in
tables over configurations, so that kernels need neither bounds checks nor the grid.

Speeds and distances are fractions in flatland; here they are integers over `unit`, the least common denominator of the
speeds of a world, which is exact.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

WAITING, READY, BROKEN_OFF_MAP, MOVING, STOPPED, BROKEN, DONE = range(7)  # flatland's TrainState
NOWHERE: Final = -1
NOTHING: Final = -1
MOST_CELLS: Final = 8191  # so that configurations, and distances, are below
UNREACHED: Final = 32767  # a distance that is infinite

# What `codes` holds of a configuration, beside the ways out in bits 0 (north) to 3 (west).
WAYS: Final = 15
SINGLE: Final = 1 << 4  # there is one way out,
AHEAD_SHIFT: Final = 16  # and from this bit on stands the configuration that it leads to
DEAD_END: Final = 1 << 5  # and the cell has no other transition
UNUSABLE: Final = 1 << 6  # a switch that joins: one way out, more than two transitions, not a diamond crossing
LOOPS: Final = 1 << 7  # single ways lead from here in a circle
PLAIN: Final = 1 << 8  # a single way out, and nothing else to note of the rails
DECIDES: Final = 1 << 9  # the `cells` rule of `common.rail.decisions`
IS_TARGET: Final = 1 << 10  # the cell is some train's target
IS_OCCUPIED: Final = 1 << 11  # a train is in the cell
NOTEWORTHY: Final = PLAIN | IS_TARGET | IS_OCCUPIED  # PLAIN alone if there is nothing to note at all

WORLD: Final = np.dtype(
    [
        ("trains", np.int32),
        ("cells", np.int32),
        ("unit", np.int32),  # a cell's length, and the denominator of speeds and distances
        ("time", np.int32),  # steps so far
        ("max_steps", np.int32),
        ("all_arrived", np.bool_),
        ("over", np.bool_),
        ("breaks", np.bool_),  # trains break down
        ("draw", np.int32),  # where in `broken` the next malfunction draws continue
        ("shortest", np.int32),  # steps of a malfunction
        ("longest", np.int32),
    ],
    align=True,
)
TRAIN: Final = np.dtype(
    [
        ("state", np.int32),
        ("config", np.int32),  # NOWHERE off the map
        ("start", np.int32),
        ("finish", np.int32),  # the configuration in which it arrived
        ("target", np.int32),  # a cell
        ("target_ways", np.int32),  # headings that count as arrived there, a bit each
        ("full_speed", np.int32),
        ("speed", np.int32),
        ("distance", np.int32),  # run since the cell's begin
        ("malfunction", np.int32),  # steps left
        ("departure", np.int32),  # the earliest
        ("arrived_at", np.int32),  # a time, or NOTHING
        ("done", np.bool_),
        # what flatland 2.2.2 remembers beyond 4.3.0
        ("committed", np.int32),  # an action, or NOTHING
        ("driving", np.bool_),
        # within a step
        ("action", np.int32),
        ("before", np.int32),
        ("want", np.int32),
        ("next_speed", np.int32),
        ("valid", np.bool_),
        ("passes", np.int8),
        ("steps_per_cell", np.int32),  # the predictor's, rounded down
        ("time_per_cell", np.float64),  # the tree's
    ],
    align=True,
)
CELL: Final = np.dtype(
    [
        ("row", np.int16),
        ("column", np.int16),
        ("train", np.int16),  # that is on it, or NOTHING
        ("claim", np.int16),  # within a step: the lowest train that wants it, or NOTHING
        ("waiting", np.int16),  # trains that are to depart from it
    ],
    align=True,
)


class Batch(NamedTuple):
    """E worlds with room for N trains, C cells and a table of malfunctions each.

    Attributes:
        worlds: [E] of WORLD.
        trains: [E, N] of TRAIN.
        cells: [E, C] of CELL.
        codes: [E, 4C] int32, what the rails say of a configuration, and who is there.
        leads: [E, 4C] int32, at `cell * 4 + way`: the configuration of a train that left the cell that way.
        distances: [E, N, 4C] int16, steps to the train's target.
        broken: [E, B] uint8, the malfunction draws, a bit each, the first in the highest bit.
        twister: [E, 625] uint32, the generator of malfunctions' durations: MT19937's key, then its position.
    """

    worlds: NDArray[np.void]
    trains: NDArray[np.void]
    cells: NDArray[np.void]
    codes: NDArray[np.int32]
    leads: NDArray[np.int32]
    distances: NDArray[np.int16]
    broken: NDArray[np.uint8]
    twister: NDArray[np.uint32]


def empty_batch(slots: int, trains: int, cells: int, broken_bytes: int) -> Batch:
    """A batch in which nothing was loaded: all worlds are over."""
    batch = Batch(
        worlds=np.zeros(slots, WORLD),
        trains=np.zeros((slots, trains), TRAIN),
        cells=np.zeros((slots, cells), CELL),
        codes=np.zeros((slots, cells * 4), np.int32),
        leads=np.zeros((slots, cells * 4), np.int32),
        distances=np.zeros((slots, trains, cells * 4), np.int16),
        broken=np.zeros((slots, broken_bytes), np.uint8),
        twister=np.zeros((slots, 625), np.uint32),
    )
    batch.worlds["over"] = True
    return batch


def enlarged(batch: Batch, cells: int, broken_bytes: int) -> Batch:
    """The same worlds with room for at least so many cells and malfunction draws."""
    slots, trains = batch.trains.shape
    larger = empty_batch(slots, trains, max(cells, batch.cells.shape[1]), max(broken_bytes, batch.broken.shape[1]))
    pairs: Any = zip(batch, larger, strict=True)
    for old, new in pairs:
        new[tuple(slice(length) for length in old.shape)] = old
    return larger
