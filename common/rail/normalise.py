"""A tree observation as a fixed vector in [-1, 0], in which 0 means that there is nothing.

Source: the text (section 3.3) flattens and normalises flatland's tree to [-1, 0] and leaves the formula open;
it is ours. Padding, infinite distances and zero counts are exactly 0.0, so that a network may skip them. With x
a feature and all arithmetic in float32, `clip(x / scale + offset, -1, 0)`:

| feature | | scale | offset |
|---|---|---|---|
| 0-4 | distance to own target, other target, train, conflict, unusable switch | 50 | -1 |
| 5 | distance to the next branch | 50 | -1 |
| 6 | at the root: distance to the target | 100 | -1 |
| 6 | elsewhere: detour through the node, `(x5 + x6) - root x6` | 25 | -1 |
| 7, 8 | trains of the same, of opposite direction | -5 | 0 |
| 9 | steps of malfunction left | -10 | 0 |
| 10 | slowest speed | 1 | -1 |
| 11 | trains ready to depart | -5 | 0 |

That is `detour`. `plain` differs in feature 6, which is the distance from any node to the target, with the scale
2 * (height + width) of the largest level and the offset -1; so each of the 12 features is normalised on its own.

So near things and many things read -1. The root's features 0-5 are zeros that mean nothing in flatland: they
are taken as infinite.
"""

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.distributions import Bounds

N_NODES: Final = 21  # of depth 2: root, then left, forward, right, back, each followed by its own four, pre-order
N_NODE_FEATURES: Final = 12
N_FEATURES: Final = N_NODES * N_NODE_FEATURES
Features = Literal["detour", "plain"]

NEAR_CELLS = 50.0  # two branches reach about as far; things beyond do not matter yet
JOURNEY_CELLS = 100.0  # longer than almost any journey on a grid of 25x25
DETOUR_CELLS = 25.0  # a worse detour is as bad as none
MANY_TRAINS = 5.0  # fewer trains than this can meet on one branch in practice
LONG_MALFUNCTION_STEPS = 10.0

_SCALE = np.array(
    [NEAR_CELLS] * 6 + [DETOUR_CELLS, -MANY_TRAINS, -MANY_TRAINS, -LONG_MALFUNCTION_STEPS, 1.0, -MANY_TRAINS],
    dtype=np.float32,
)
_OFFSET = np.array([-1.0] * 7 + [0.0, 0.0, 0.0, -1.0, 0.0], dtype=np.float32)
_LEAST, _MOST = np.float32(-1), np.float32(0)


def journey_cells(bounds: Bounds | None) -> int:
    """The scale of distances to the target in `plain` features: 100 for the study's 25x25."""
    if bounds is None:
        raise ValueError("plain features have the scale of the largest level: give its bounds")
    return 2 * (bounds.height + bounds.width)


def normalise(
    tree: NDArray[np.float32] | NDArray[np.float64], features: Features = "detour", journey: float = JOURNEY_CELLS
) -> NDArray[np.float32]:
    """The vector of a tree.

    Args:
        tree: [nodes, 12], flatland's raw features; a missing node is a row of NaN. Depth 2 has 21 nodes.
        features: how they are normalised; see the module.
        journey: the scale of distances to the target.

    Returns:
        [nodes * 12], node after node.
    """
    x = tree.astype(np.float32)
    distances = x[:, 6] / np.float32(journey)
    with np.errstate(invalid="ignore"):  # a root without a way: inf - inf is nothing
        x[1:, 6] = (x[1:, 5] + x[1:, 6]) - x[0, 6]
    x[0, :6] = np.inf
    x /= _SCALE
    if features == "plain":
        x[:, 6] = distances
    else:
        x[0, 6] = distances[0]
    x += _OFFSET
    np.minimum(np.maximum(x, _LEAST, out=x), _MOST, out=x)
    x[np.isnan(x)] = 0
    return x.reshape(-1)
