"""Tree observations: flatland's tree, normalised to a vector in [-1, 0] in which 0 means that there is nothing.

What nodes and their features are: `common.rail.compiled.tree`; how they are normalised: `common.rail.normalise`.
A tree of depth 1, 2, 3 has 5, 21, 85 nodes of 12 features each, so 60, 252, 1020 values: the root, then left, forward,
right, back, each followed by its own, pre-order.
"""

from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from railctl.common.kernel import bare_kernel
from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.rail.compiled import tree as modes
from railctl.common.rail.compiled.arrays import Batch
from railctl.common.rail.compiled.tree import N_NODE_FEATURES, STOCK, Sight, forecast, grow, nodes_of
from railctl.common.rail.normalise import (
    DETOUR_CELLS,
    JOURNEY_CELLS,
    LONG_MALFUNCTION_STEPS,
    MANY_TRAINS,
    NEAR_CELLS,
    journey_cells,
)
from railctl.common.strict import Strict

PLAIN: Final = 1  # of `features`
NEAR: Final = np.float32(NEAR_CELLS)
DETOUR: Final = np.float32(DETOUR_CELLS)
MANY: Final = np.float32(-MANY_TRAINS)
LONG: Final = np.float32(-LONG_MALFUNCTION_STEPS)
NULL: Final = np.float32(0)
LEAST: Final = np.float32(-1)


class TreeObservation(Strict):
    """Flatland's tree observation (`TreeObsForRailEnv`) as a vector.

    Attributes:
        depth: of the tree.
        features: `plain`: each of the 12 features is normalised on its own, as the study says; `detour`: feature 6 of a
            node is the detour through it, which is ours.
        conflicts: whether trees show predicted conflicts. `library`: as the library of the rules does, so under legacy
            rules, not under stock ones, where it is an error of the library; `repaired`: under both.
    """

    kind: Literal["tree"] = "tree"
    depth: int = Field(default=2, ge=1, le=3)
    features: Literal["detour", "plain"] = "detour"
    conflicts: Literal["library", "repaired"] = "library"

    @field_validator("features", mode="before")
    @classmethod
    def _renamed(cls, features: Any) -> Any:
        return "detour" if features == "study" else features  # as older runs and checkpoints have it

    @property
    def low(self) -> float:
        """The least that a value can be."""
        return -1.0

    @property
    def high(self) -> float:
        """The most that a value can be."""
        return 0.0

    def n_features(self, bounds: Bounds | None = None) -> int:  # noqa: ARG002  (other observations depend on it)
        """F, the length of the vector."""
        return nodes_of(self.depth) * N_NODE_FEATURES

    def mode(self, rules: Rules) -> int:
        """Of `common.rail.compiled.tree`."""
        if rules == "legacy":
            return modes.LEGACY
        return modes.STOCK if self.conflicts == "library" else modes.REPAIRED

    def journey(self, bounds: Bounds | None) -> int:
        """The scale of distances to the target, in cells."""
        return int(JOURNEY_CELLS) if self.features == "detour" else journey_cells(bounds)

    def header(self, rules: Rules, bounds: Bounds | None) -> tuple[int, ...]:
        """What `look_at_trees` is told: mode, depth, features, scale of distances to the target."""
        return self.mode(rules), self.depth, int(self.features == "plain"), self.journey(bounds)


@bare_kernel
def clip(x: np.float32) -> np.float32:
    """Into [-1, 0]; nothing for what is no number."""
    return LEAST if x <= LEAST else x if x < NULL else NULL  # noqa: FURB136  (a comparison with NaN is false)


@bare_kernel
def normalise_rows(
    nodes: NDArray[np.float32], present: NDArray[np.int32], count: int, plain: bool, journey: np.float32
) -> None:
    """`common.rail.normalise.normalise` in place, of the rows that are there."""
    distance = nodes[0, 6]
    for feature in range(6):
        nodes[0, feature] = 0
    for at in range(count):
        node = nodes[present[at]]
        if at == 0 or plain:
            node[6] = clip(node[6] / journey + LEAST)
        else:
            node[6] = clip(((node[5] + node[6]) - distance) / DETOUR + LEAST)
        if at > 0:
            for feature in range(6):
                node[feature] = clip(node[feature] / NEAR + LEAST)
        node[7] = clip(node[7] / MANY + NULL)
        node[8] = clip(node[8] / MANY + NULL)
        node[9] = clip(node[9] / LONG + NULL)
        node[10] = clip(node[10] + LEAST)
        node[11] = clip(node[11] / MANY + NULL)


@bare_kernel
def look_at_trees(
    batch: Batch, sight: Sight, header: NDArray[np.int64], asking: NDArray[np.bool_], vectors: NDArray[np.float32]
) -> None:
    """Fill `vectors` [K, F], zeros so far, of the K trains that `asking` [E, N] marks; all must be visible."""
    mode, depth, plain, journey = int(header[0]), int(header[1]), header[2] == PLAIN, np.float32(header[3])
    row = 0
    for slot in range(len(asking)):
        seen = False
        for at in range(batch.worlds[slot]["trains"]):
            if asking[slot, at]:
                if not seen and mode != STOCK:
                    forecast(batch, slot, sight, mode)
                seen = True
                nodes = vectors[row].reshape((vectors.shape[1] // N_NODE_FEATURES, N_NODE_FEATURES))
                count = grow(batch, slot, at, sight, mode, depth, nodes)
                normalise_rows(nodes, sight.present, count, plain, journey)
                row += 1
