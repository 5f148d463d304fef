"""Which trains must decide: three rules, over the tables of a batch.

| mode | a train decides when it is ready to depart, or when it is on the map, not committed, and ... |
|---|---|
| ALWAYS | at the end of a cell: flatland-rl 4.3.0's `action_required` |
| LEGACY | (nothing more): that of 2.2.2 |
| CELLS | at the end of a cell, not broken down, and where `common.rail.decisions` says so |
"""

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import (
    BROKEN,
    DECIDES,
    MOVING,
    NOTHING,
    READY,
    STOPPED,
)

ALWAYS: Final = 0
LEGACY: Final = 1
CELLS: Final = 2

Decisions = Literal["cells", "legacy", "always"]
DECISIONS: Final = {"cells": CELLS, "legacy": LEGACY, "always": ALWAYS}


@bare_kernel
def decides_there(codes: NDArray[np.int32], here: int, mode: int) -> bool:
    """Whether a train decides when it comes to the end of a cell in a configuration."""
    return mode != CELLS or codes[here] & DECIDES != 0


@bare_kernel
def decides(train: np.void, codes: NDArray[np.int32], unit: int, mode: int) -> bool:
    """Whether a train of a world must decide."""
    state = train["state"]
    if state == READY:
        return True
    if state not in (MOVING, STOPPED, BROKEN) or train["committed"] != NOTHING:
        return False
    if mode == LEGACY:
        return True
    if train["distance"] + train["full_speed"] < unit:
        return False
    return mode == ALWAYS or (train["malfunction"] == 0 and codes[train["config"]] & DECIDES != 0)
