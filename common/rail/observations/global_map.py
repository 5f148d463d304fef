"""The global observation: the whole grid as a train sees it; see `common.rail.observations.maps` for every value.

Source: `GlobalObsForRailEnv` of flatland-rl 4.3.0. The vector is an array [H, W, 23], flattened row after row, where H
and W are those of the run's largest level; a smaller level is at its north-western corner, the rest is 0.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.rail.compiled.arrays import Batch
from railctl.common.rail.compiled.tree import Sight
from railctl.common.rail.observations.maps import CHANNELS, MapObservation, draw_map


class GlobalObservation(MapObservation):
    """The whole grid; its size is that of the run's largest level."""

    kind: Literal["global"] = "global"

    def n_features(self, bounds: Bounds | None) -> int:
        """F = H * W * 23."""
        if bounds is None:
            raise ValueError("a global observation is as large as the largest level: give its bounds")
        return bounds.height * bounds.width * CHANNELS

    def header(self, rules: Rules, bounds: Bounds | None) -> tuple[int, ...]:
        """What `look_at_maps` is told: whether the rules are legacy, H, W."""
        if bounds is None:
            raise ValueError("a global observation is as large as the largest level: give its bounds")
        return int(rules == "legacy"), bounds.height, bounds.width


@bare_kernel
def look_at_maps(
    batch: Batch,
    sight: Sight,  # noqa: ARG001  (others need it)
    header: NDArray[np.int64],
    asking: NDArray[np.bool_],
    vectors: NDArray[np.float32],
) -> None:
    """Fill `vectors` [K, F], zeros so far, of the K trains that `asking` [E, N] marks."""
    legacy, height, width = header[0] == 1, int(header[1]), int(header[2])
    row = 0
    for slot in range(len(asking)):
        for at in range(batch.worlds[slot]["trains"]):
            if asking[slot, at]:
                draw_map(batch, slot, at, 0, 0, legacy, vectors[row].reshape((height, width, CHANNELS)))
                row += 1
