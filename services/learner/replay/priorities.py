"""Proportional priorities: "Prioritized Experience Replay", Schaul et al. 2016, arXiv:1511.05952.

Item i is drawn with probability P(i) = p_i^alpha / sum p^alpha, where p_i is its priority and a little more, so that
nothing is lost for good. As in the paper's appendix B.2.1 the sum is cut into as many equal parts as are drawn, with
one draw in each (stratified), and a tree of sums finds them in logarithmic time. A sum is always that of its two
children, never adjusted by a difference, so it does not drift, and the leaves determine the whole tree.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.arithmetic import power

ADDED_TO_PRIORITY = 1e-6


class Priorities:
    """The priorities of at most `capacity` items.

    Attributes:
        tree: node i has the children 2i and 2i + 1; the root is 1, leaves come last.
    """

    def __init__(self, capacity: int, alpha: float) -> None:
        self._alpha = alpha
        self._maximum = 1.0
        leaves = 1 << (capacity - 1).bit_length()
        self.tree = np.zeros(2 * leaves)
        self._leaves = self.tree[leaves : leaves + capacity]

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return self.tree.nbytes

    @property
    def total(self) -> float:
        """Sum over all items of (priority + a little)^alpha."""
        return float(self.tree[1])

    @property
    def largest(self) -> float:
        """What an item of the largest priority so far adds to the total."""
        return float(power(self._maximum + ADDED_TO_PRIORITY, self._alpha))

    def put(self, places: NDArray[np.int64], priorities: NDArray[np.floating[Any]] | None) -> None:
        """Give the items at `places` [B] these priorities; None: the largest so far, 1 at the start.

        The last one counts if a place occurs more than once.

        Raises:
            ValueError: a priority is negative or not finite, or a place does not exist; then nothing has changed.
        """
        if priorities is None:
            priorities = np.full(len(places), self._maximum)
        priorities = np.array(priorities, np.float64)
        if priorities.shape != places.shape:
            raise ValueError(f"{len(places)} items need as many priorities, got {priorities.shape}")
        largest = update(self.tree, places, priorities, len(self._leaves), self._alpha)
        if largest < 0:
            raise ValueError("a priority must be finite and at least 0, its place one of the replay")
        self._maximum = max(self._maximum, largest)

    def temper(self, alpha: float) -> None:
        """Have all priorities count with another exponent, which is less."""
        if alpha != self._alpha:
            raise_leaves(self._leaves, alpha / self._alpha)
            self._add_up()
            self._alpha = alpha

    def state(self, size: int) -> dict[str, NDArray[Any]]:
        """A copy of everything, for items at the first `size` places."""
        return {"priorities": self._leaves[:size].copy(), "priority_maximum": np.array(self._maximum)}

    def restore(self, leaves: NDArray[np.float64], maximum: float, alpha: float) -> None:
        """Take on a `state` that has this exponent."""
        self._maximum, self._alpha = maximum, alpha
        self.tree[:] = 0
        self._leaves[: len(leaves)] = leaves
        self._add_up()

    def _add_up(self) -> None:
        """All sums above the leaves."""
        level = len(self.tree) // 2
        while level > 1:
            self.tree[level // 2 : level] = self.tree[level : 2 * level : 2] + self.tree[level + 1 : 2 * level : 2]
            level //= 2


@bare_kernel
def update(
    tree: NDArray[np.float64], places: NDArray[np.int64], priorities: NDArray[np.float64], capacity: int, alpha: float
) -> float:
    """Set leaves, in their order, then all sums above them, level by level: so the processor does many at a time.

    `priorities` is overwritten.

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
        priorities[item] = power(priorities[item] + ADDED_TO_PRIORITY, alpha)
    for item in range(len(places)):
        tree[leaves + places[item]] = priorities[item]
    parents, level = leaves // 2, 1
    while parents > 0:
        for place in places:
            node = parents + (place >> level)
            tree[node] = tree[2 * node] + tree[2 * node + 1]
        parents, level = parents // 2, level + 1
    return largest


@bare_kernel
def raise_leaves(leaves: NDArray[np.float64], exponent: float) -> None:
    """Raise what is not zero to a power."""
    for place in range(len(leaves)):
        if leaves[place] > 0:
            leaves[place] = power(leaves[place], exponent)


@bare_kernel
def find(tree: NDArray[np.float64], draws: NDArray[np.float64], places: NDArray[np.int64]) -> None:
    """Fill `places` [B] with where the sum of all leaves before passes (i + draws[i]) / B of the total.

    All draws go down the tree together, level by level, as in `update`; `draws` [B] is overwritten. A draw that
    rounding carries past the last leaf ends on the last one that is not zero.
    """
    leaves, size = len(tree) // 2, len(draws)
    for item in range(size):
        draws[item] = (item + draws[item]) / size * tree[1]
        places[item] = 1
    level = 1
    while level < leaves:
        for item in range(size):
            node = 2 * places[item]
            left, draw = tree[node], draws[item]
            goes_right = (draw >= left) & (tree[node + 1] > 0)
            draws[item] = draw - (left if goes_right else 0.0)
            places[item] = node + goes_right
        level *= 2
    for item in range(size):
        places[item] -= leaves


@bare_kernel
def weigh(
    tree: NDArray[np.float64],
    places: NDArray[np.int64],
    beta: float,
    leaves: NDArray[np.float64],
    weights: NDArray[np.float32],
) -> None:
    """Fill `weights` [B] with the importance weights (1/(N P(i)))^beta of the items at `places` [B] over the largest.

    `leaves` [B] is overwritten with what they add to the total.
    """
    first, least = len(tree) // 2, np.inf
    for item in range(len(places)):
        leaves[item] = tree[first + places[item]]
        least = min(least, leaves[item])
    for item in range(len(leaves)):
        weights[item] = power(least / leaves[item], beta)
