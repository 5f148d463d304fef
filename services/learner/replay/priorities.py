"""Proportional priorities: "Prioritized Experience Replay", Schaul et al. 2016, arXiv:1511.05952.

Item i is drawn with probability P(i) = p_i^alpha / sum p^alpha, where p_i is its priority and a little more, so that
nothing is lost for good. As in the paper's appendix B.2.1 the sum is cut into as many equal parts as are drawn, with
one draw in each (stratified), and a tree of sums finds them in logarithmic time. A sum is always that of its two
children, never adjusted by a difference, so it does not drift, and the leaves determine the whole tree.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel

ADDED_TO_PRIORITY = 1e-6


class Priorities:
    """The priorities of at most `capacity` items."""

    def __init__(self, capacity: int, alpha: float) -> None:
        self._alpha = alpha
        self._maximum = 1.0
        leaves = 1 << (capacity - 1).bit_length()
        self._tree = np.zeros(2 * leaves)  # node i has the children 2i and 2i + 1; the root is 1, leaves come last
        self._leaves = self._tree[leaves : leaves + capacity]

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return self._tree.nbytes

    @property
    def total(self) -> float:
        """Sum over all items of (priority + a little)^alpha."""
        return float(self._tree[1])

    @property
    def largest(self) -> float:
        """What an item of the largest priority so far adds to the total."""
        return float((self._maximum + ADDED_TO_PRIORITY) ** self._alpha)

    def put(self, places: NDArray[np.int64], priorities: NDArray[np.float64] | None) -> None:
        """Give the items at `places` [B] these priorities; none: the largest so far, 1 at the start.

        The last one counts if a place occurs more than once.

        Raises:
            ValueError: a priority is negative or not finite, or a place does not exist; then nothing has changed.
        """
        if priorities is None:
            priorities = np.full(len(places), self._maximum)
        priorities = np.require(priorities, np.float64, ("C", "A", "W"))
        if priorities.shape != places.shape:
            raise ValueError(f"{len(places)} items need as many priorities, got {priorities.shape}")
        largest = update(self._tree, places, priorities, len(self._leaves), self._alpha)
        if largest < 0:
            raise ValueError("a priority must be finite and at least 0, its place one of the replay")
        self._maximum = max(self._maximum, largest)

    def draw(self, rng: np.random.Generator, beta: float, weights: NDArray[np.float32]) -> NDArray[np.int64]:
        """The places [B] of as many items as `weights` [B] is long, which gets their importance weights.

        Weights are (1/(N P(i)))^beta divided by the largest among them.
        """
        places = np.empty(len(weights), np.int64)
        find(self._tree, rng.random(len(weights)), beta, places, weights)
        return places

    def state(self, size: int) -> dict[str, NDArray[Any]]:
        """A copy of everything, for items at the first `size` places."""
        return {"priorities": self._leaves[:size].copy(), "priority_maximum": np.array(self._maximum)}

    def restore(self, leaves: NDArray[np.float64], maximum: float) -> None:
        """Take on a `state`."""
        self._maximum = maximum
        self._tree[:] = 0
        self._leaves[: len(leaves)] = leaves
        level = len(self._tree) // 2
        while level > 1:
            self._tree[level // 2 : level] = self._tree[level : 2 * level : 2] + self._tree[level + 1 : 2 * level : 2]
            level //= 2


@bare_kernel
def update(
    tree: NDArray[np.float64], places: NDArray[np.int64], priorities: NDArray[np.float64], capacity: int, alpha: float
) -> float:
    """Set leaves, in their order, then all sums above them, level by level: so the processor does many at a time.

    Returns:
        The largest priority (0 for none), or -1 if there is one that cannot be; then nothing has changed.
    """
    largest = 0.0
    for item in range(len(places)):
        if not (0 <= places[item] < capacity and 0 <= priorities[item] < np.inf):
            return -1.0
        largest = max(largest, priorities[item])
    leaves = len(tree) // 2
    for item in range(len(places)):
        tree[leaves + places[item]] = (priorities[item] + ADDED_TO_PRIORITY) ** alpha
    parents, level = leaves // 2, 1
    while parents > 0:
        for place in places:
            node = parents + (place >> level)
            tree[node] = tree[2 * node] + tree[2 * node + 1]
        parents, level = parents // 2, level + 1
    return largest


@bare_kernel
def find(
    tree: NDArray[np.float64],
    draws: NDArray[np.float64],
    beta: float,
    places: NDArray[np.int64],
    weights: NDArray[np.float32],
) -> None:
    """Where the sum of all leaves before passes (i + draws[i]) / B of the total, and the weights found there.

    All draws go down the tree together, level by level, as in `update`; `draws` is overwritten. A draw that rounding
    carries past the last leaf ends on the last one that is not zero.
    """
    leaves, size = len(tree) // 2, len(draws)
    for item in range(size):
        draws[item] = (item + draws[item]) / size * tree[1]
        places[item] = 1
    level = 1
    while level < leaves:
        for item in range(size):
            node = 2 * places[item]
            goes_right = (draws[item] >= tree[node]) & (tree[node + 1] > 0)
            draws[item] -= tree[node] * goes_right
            places[item] = node + goes_right
        level *= 2
    least = np.inf
    for place in places:
        least = min(least, tree[place])
    for item in range(size):
        weights[item] = (least / tree[places[item]]) ** beta
        places[item] -= leaves
