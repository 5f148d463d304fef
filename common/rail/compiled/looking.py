"""Raw trees of all trains in one call, for comparisons and measurements."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import NOWHERE, Batch
from railctl.common.rail.compiled.tree import STOCK, Sight, forecast, grow, standpoint


@bare_kernel
def look_at_all(batch: Batch, sight: Sight, mode: int, depth: int, trees: NDArray[np.float32]) -> None:
    """The raw trees [E, N, nodes, 12] of all trains; missing nodes, and trains that are invisible, are NaN."""
    for slot in range(len(batch.worlds)):
        shown = trees[slot]
        shown.reshape(shown.size)[:] = np.nan
        if mode != STOCK:
            forecast(batch, slot, sight, mode)
        for at in range(batch.worlds[slot]["trains"]):
            if standpoint(batch.trains[slot, at], mode) != NOWHERE:
                grow(batch, slot, at, sight, mode, depth, shown[at])
