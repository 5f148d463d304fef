"""The traffic observation: for each exit of a train, where it leads, and whom it meets there; values in [-1, 1].

Exits are left, forward and right; a train off the map, or with a single way out, has a forward one only. Behind an
exit a train takes the shortest path, as all others do from where they are (`common.rail.compiled.ways`). The vector is

    [train: 13 | 3 exits: 16 each | `others` rows: 10 of another train, then for each of the 3 exits 15 of the two ways]

and does not grow with the number of trains: the rows are the trains with the earliest conflict behind any exit (see
`common.rail.compiled.conflicts`, also for the 15 numbers), then the nearest; of equals those with the lower number.
0 means that there is nothing: what is said of exits that are not there, and rows without a train, are zeros. Unless
something else is said values are kept between 0 and 1, and nearness is 1 - cells / 50, or 0.

| train | meaning | value |
|---|---|---|
| 0 | it is on the map | 0 or 1 |
| 1 | distance to its target | cells / 100 |
| 2 | time | share of the step limit |
| 3, 4 | trains on the map; trains that have not arrived | number / 10 |
| 5 | rank: those of them with a shorter way | share of the others |
| 6 | steps to spare before the step limit | share of it, -1 to 1 |
| 7 | steps to spare before the latest arrival | share of the step limit, -1 to 1 |
| 8 | other trains whose way leads through its cell | number / 10 |
| 9 | patience: steps that it has stood or waited to depart, to now | steps / 20 |
| 10 | it has stopped, or is broken down | 0 or 1 |
| 11 | malfunction left | steps / 20 |
| 12 | full speed | cells a step |

| exit | meaning | value |
|---|---|---|
| 0 | there is one | 0 or 1 |
| 1 | an interlocking of mode `proof` would grant it now; where nothing is decided, any exit | 0 or 1 |
| 2 | it leads to the target | 0 or 1 |
| 3 | the way from there | cells / 100; 1 if there is none |
| 4 | the detour that it is | cells / 25; 1 if there is no way |
| 5 | it is on a shortest way | 0 or 1 |
| 6 | another train is in the next cell | 0 or 1 |
| 7 | the next cell is the target | 0 or 1 |
| 8 | the way to the next cell where the train decides, or to its target | cells / 20 |
| 9 | no more decisions before the target | 0 or 1 |
| 10 | the first train on the way | nearness |
| 11 | the first oncoming one: that heads another way than this train will there | nearness |
| 12 | oncoming trains on the way | number / 5 |
| 13 | the longest malfunction left on the way | steps / 20 |
| 14 | conflicts with trains that have no row | number / 5 |
| 15 | the earliest of these conflicts | 1 - steps / 50 |

| other train | meaning | value |
|---|---|---|
| 0 | there is one | 0 or 1 |
| 1 | it is on the map | 0 or 1 |
| 2 | it has stopped, or is broken down | 0 or 1 |
| 3 | its number is lower: it goes first where both want the same cell | 0 or 1 |
| 4 | distance to its target | cells / 100 |
| 5 | malfunction left | steps / 20 |
| 6 | full speed | cells a step |
| 7 | its patience | steps / 20 |
| 8 | rows and columns between the two | 1 - cells / 50 |
| 9 | how near the cell of this train is on its way | nearness |
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from railctl.common.kernel import bare_kernel
from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.rail.compiled.arrays import DONE, Batch
from railctl.common.rail.compiled.tree import Sight
from railctl.common.rail.compiled.ways import find_ways
from railctl.common.rail.interlocking.asking import begin
from railctl.common.rail.interlocking.signals import INTERLOCKINGS
from railctl.common.rail.observations.traffic_numbers import describe_exits, describe_others, describe_train
from railctl.common.rail.observations.traffic_shape import EXITS_END, N_EXIT, N_EXITS, N_ROW, N_TRAIN
from railctl.common.strict import Strict


class TrafficObservation(Strict):
    """Where each exit leads, and whom a train meets there.

    Attributes:
        others: trains that are told apart, the most urgent ones.
        proof: the mode of interlocking that says whether an exit would be granted, whatever that of the world is.
    """

    kind: Literal["traffic"] = "traffic"
    others: int = Field(default=6, ge=1, le=32)
    proof: Literal["safe", "planned"] = "planned"

    @property
    def low(self) -> float:
        """The least that a value can be."""
        return -1.0

    @property
    def high(self) -> float:
        """The most that a value can be."""
        return 1.0

    def n_features(self, bounds: Bounds | None = None) -> int:  # noqa: ARG002  (other observations depend on it)
        """F = 61 + 55 * others."""
        return EXITS_END + self.others * N_ROW

    def header(self, rules: Rules, bounds: Bounds | None) -> tuple[int, ...]:  # noqa: ARG002
        """What `look_at_traffic` is told: the number of rows, and the mode of interlocking."""
        return self.others, INTERLOCKINGS[self.proof]


@bare_kernel
def look_at_traffic(
    batch: Batch,
    sight: Sight,
    decisions: int,
    header: NDArray[np.int64],
    asking: NDArray[np.bool_],
    vectors: NDArray[np.float32],
) -> None:
    """Fill `vectors` [K, F], zeros so far, of the K trains that `asking` [E, N] marks; who has arrived sees nothing."""
    others, mode = int(header[0]), int(header[1])
    row = 0
    for slot in range(len(asking)):
        known = False
        for at in range(batch.worlds[slot]["trains"]):
            if not asking[slot, at]:
                continue
            vector = vectors[row]
            row += 1
            if batch.trains[slot, at]["state"] == DONE:
                continue
            if not known:
                find_ways(batch, slot, sight.ways)
                begin(batch, slot, mode, decisions, sight.signals)
                known = True
            describe_train(batch, slot, at, sight, vector[:N_TRAIN])
            exits, rows = vector[N_TRAIN:EXITS_END].reshape((N_EXITS, N_EXIT)), vector[EXITS_END:]
            describe_exits(batch, slot, at, sight, decisions, mode, exits)
            describe_others(batch, slot, at, sight, exits, rows.reshape((others, N_ROW)))
