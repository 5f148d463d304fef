"""Observations of many trains in one call: raw trees, and the vectors of `common.rail.normalise`, bit for bit."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel
from common.rail.compiled.arrays import NOWHERE, Batch
from common.rail.compiled.tree import STOCK, Sight, forecast, grow, standpoint
from common.rail.normalise import DETOUR_CELLS, JOURNEY_CELLS, LONG_MALFUNCTION_STEPS, MANY_TRAINS, NEAR_CELLS

NEAR: Final = np.float32(NEAR_CELLS)
JOURNEY: Final = np.float32(JOURNEY_CELLS)
DETOUR: Final = np.float32(DETOUR_CELLS)
MANY: Final = np.float32(-MANY_TRAINS)
LONG: Final = np.float32(-LONG_MALFUNCTION_STEPS)
NULL: Final = np.float32(0)
LEAST: Final = np.float32(-1)


@bare_kernel
def clip(x: np.float32) -> np.float32:
    """Into [-1, 0]; nothing for what is no number."""
    return LEAST if x <= LEAST else x if x < NULL else NULL  # noqa: FURB136  (a comparison with NaN is false)


@bare_kernel
def normalise_rows(nodes: NDArray[np.float32], present: NDArray[np.int32], count: int) -> None:
    """`common.rail.normalise.normalise` in place, of the rows that are there."""
    journey = nodes[0, 6]
    for feature in range(6):
        nodes[0, feature] = 0
    for at in range(count):
        node = nodes[present[at]]
        if at == 0:
            node[6] = clip(journey / JOURNEY + LEAST)
        else:
            node[6] = clip(((node[5] + node[6]) - journey) / DETOUR + LEAST)
            for feature in range(6):
                node[feature] = clip(node[feature] / NEAR + LEAST)
        node[7] = clip(node[7] / MANY + NULL)
        node[8] = clip(node[8] / MANY + NULL)
        node[9] = clip(node[9] / LONG + NULL)
        node[10] = clip(node[10] + LEAST)
        node[11] = clip(node[11] / MANY + NULL)


@bare_kernel
def look(
    batch: Batch, sight: Sight, asking: NDArray[np.bool_], mode: int, depth: int, vectors: NDArray[np.float32]
) -> None:
    """The vectors [K, nodes, 12] of the K trains that `asking` [E, N] marks, slot after slot; all must be visible."""
    row = 0
    vectors.reshape(vectors.size)[:] = 0
    for slot in range(len(asking)):
        seen = False
        for at in range(batch.worlds[slot]["trains"]):
            if asking[slot, at]:
                if not seen and mode != STOCK:
                    forecast(batch, slot, sight, mode)
                seen = True
                count = grow(batch, slot, at, sight, mode, depth, vectors[row])
                normalise_rows(vectors[row], sight.present, count)
                row += 1


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
