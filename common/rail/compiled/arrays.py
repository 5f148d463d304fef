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

from railctl.common.rail.compiled.malfunctions import KEY_WORDS, KNOWN_WORDS

WAITING, READY, BROKEN_OFF_MAP, MOVING, STOPPED, BROKEN, DONE = range(7)  # flatland's TrainState
NOWHERE: Final = -1
NOTHING: Final = -1
MOST_CELLS: Final = (1 << 17) - 1  # so that the configurations fit into `codes`
UNREACHED: Final = 32767  # a distance that is infinite

# What `codes` holds of a configuration, beside the ways out in bits 0 (north) to 3 (west).
WAYS: Final = 15
SINGLE: Final = 1 << 4  # there is one way out,
AHEAD_SHIFT: Final = 12  # and from this bit on stands the configuration that it leads to
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
        # see `common.rail.compiled.malfunctions`
        ("chance", np.float64),  # that a train breaks down, times `WHOLE`
        ("shortest", np.int32),  # flatland's `min_duration`
        ("longest", np.int32),
        ("draw", np.int32),  # the index of the last uniform that was used
        ("position", np.int32),  # in the generator's key before the uniforms
        ("found", np.int32),  # words of the key after them that are known
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
        ("latest_arrival", np.int32),
        ("arrived_at", np.int32),  # a time, or NOTHING
        ("stood", np.int32),  # steps, to now, that it has stood on the map or waited to depart
        ("done", np.bool_),
        ("stuck", np.bool_),  # in a deadlock, if the reward asks for it
        ("bound", np.int32),  # the move that it decided on and was hindered from so far, or NOTHING; of stock rules
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
    """E worlds with room for N trains, C cells and, if any has malfunctions, W words of their generator each.

    Attributes:
        worlds: [E] of WORLD.
        trains: [E, N] of TRAIN.
        cells: [E, C] of CELL.
        codes: [E, 4C] int32, what the rails say of a configuration, and who is there.
        leads: [E, 4C] int32, at `cell * 4 + way`: the configuration of a train that left the cell that way.
        distances: [E, N, 4C] int16, steps to the train's target.
        uniforms: [E, 625 or 1] uint32, the generator of malfunctions: MT19937's key, then its position.
        later: [E, 625 or 1] uint32, the generator of their durations.
        known: [E, W or 1] uint32, words between the two.
    """

    worlds: NDArray[np.void]
    trains: NDArray[np.void]
    cells: NDArray[np.void]
    codes: NDArray[np.int32]
    leads: NDArray[np.int32]
    distances: NDArray[np.int16]
    uniforms: NDArray[np.uint32]
    later: NDArray[np.uint32]
    known: NDArray[np.uint32]


def empty_batch(slots: int, trains: int, cells: int, *, breaks: bool = False) -> Batch:
    """A batch in which nothing was loaded: all worlds are over. `breaks`: there is room for malfunctions."""
    batch = Batch(
        worlds=np.zeros(slots, WORLD),
        trains=np.zeros((slots, trains), TRAIN),
        cells=np.zeros((slots, cells), CELL),
        codes=np.zeros((slots, cells * 4), np.int32),
        leads=np.zeros((slots, cells * 4), np.int32),
        distances=np.zeros((slots, trains, cells * 4), np.int16),
        uniforms=np.zeros((slots, KEY_WORDS + 1 if breaks else 1), np.uint32),
        later=np.zeros((slots, KEY_WORDS + 1 if breaks else 1), np.uint32),
        known=np.zeros((slots, KNOWN_WORDS if breaks else 1), np.uint32),
    )
    batch.worlds["over"] = True
    return batch


def enlarged(batch: Batch, cells: int, *, breaks: bool) -> Batch:
    """The same worlds with room for at least so many cells, and for malfunctions if there is or shall be."""
    slots, trains = batch.trains.shape
    breaks = breaks or batch.known.shape[1] > 1
    larger = empty_batch(slots, trains, max(cells, batch.cells.shape[1]), breaks=breaks)
    pairs: Any = zip(batch, larger, strict=True)
    for old, new in pairs:
        new[tuple(slice(length) for length in old.shape)] = old
    return larger
