"""Room for the interlocking to work in, and its modes."""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.rail.compiled.arrays import Batch
from common.rail.world import N_ACTIONS

Interlocking = Literal["off", "valid", "safe", "planned"]
OFF, VALID, SAFE, PLANNED = range(4)
INTERLOCKINGS: Final = {"off": OFF, "valid": VALID, "safe": SAFE, "planned": PLANNED}
ALL_ACTIONS: Final = (1 << N_ACTIONS) - 1  # a bit each


class Signals(NamedTuple):
    """One world at a time.

    Attributes:
        asked: [N], who has been asked in this step.
        rounds: [1], how often all trains were gone through in this step.
    """

    asked: NDArray[np.bool_]
    rounds: NDArray[np.int32]


def signals_for(batch: Batch) -> Signals:
    """Room for any world of a batch."""
    return Signals(asked=np.zeros(batch.trains.shape[1], np.bool_), rounds=np.zeros(1, np.int32))
