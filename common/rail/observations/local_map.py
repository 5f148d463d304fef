"""The local observation: the cells around a train; see `common.rail.observations.maps` for every value.

Source: the local observation of the text (section 3.3), a section of the global one. The vector is an array
[2 * radius + 1, 2 * radius + 1, 23], flattened row after row, with the train in the middle and north always up; cells
off the grid are 0.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from railctl.common.kernel import bare_kernel
from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.rail.compiled.arrays import Batch
from railctl.common.rail.compiled.tree import Sight
from railctl.common.rail.observations.maps import CHANNELS, MapObservation, draw_map, viewpoint


class LocalObservation(MapObservation):
    """All cells that are at most `radius` rows and columns away."""

    kind: Literal["local"] = "local"
    radius: int = Field(default=5, ge=1, le=50)

    def n_features(self, bounds: Bounds | None = None) -> int:  # noqa: ARG002  (other observations depend on it)
        """F = (2 * radius + 1) ^ 2 * 23."""
        return (2 * self.radius + 1) ** 2 * CHANNELS

    def header(self, rules: Rules, bounds: Bounds | None) -> tuple[int, ...]:  # noqa: ARG002
        """What `look_around` is told: whether the rules are legacy, and the radius."""
        return int(rules == "legacy"), self.radius


@bare_kernel
def look_around(
    batch: Batch,
    sight: Sight,  # noqa: ARG001  (others need it)
    header: NDArray[np.int64],
    asking: NDArray[np.bool_],
    vectors: NDArray[np.float32],
) -> None:
    """Fill `vectors` [K, F], zeros so far, of the K trains that `asking` [E, N] marks."""
    legacy, radius = header[0] == 1, int(header[1])
    side = 2 * radius + 1
    row = 0
    for slot in range(len(asking)):
        for at in range(batch.worlds[slot]["trains"]):
            if asking[slot, at]:
                cell = batch.cells[slot, viewpoint(batch, slot, at) >> 2]
                north, west = int(cell["row"]) - radius, int(cell["column"]) - radius
                draw_map(batch, slot, at, north, west, legacy, vectors[row].reshape((side, side, CHANNELS)))
                row += 1
