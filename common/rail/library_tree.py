"""The tree observation of flatland-rl 4.3.0 as the library makes it, as an array."""

from typing import Any

import numpy as np
from flatland.envs.observations import TreeObsForRailEnv
from flatland.envs.rail_env import RailEnv
from numpy.typing import NDArray

from railctl.common.rail.compiled.tree import N_NODE_FEATURES, nodes_of


class LibraryTree:
    """Trees of the trains of an environment: `update` after every step, then `tree`.

    It has no predictor: in 4.3.0 that would not change the trees.
    """

    def __init__(self, env: RailEnv, depth: int) -> None:
        self._nodes = nodes_of(depth)
        self._builder = TreeObsForRailEnv(depth)
        self._builder.reset(env)

    def update(self) -> None:
        """Take over where the trains are."""
        self._builder.get_many([])

    def tree(self, train: int) -> NDArray[np.float32]:
        """[nodes, 12]: the raw features that `train` sees, NaN where there is no node."""
        rows = np.full((self._nodes, N_NODE_FEATURES), np.nan, np.float32)
        flatten(self._builder.get(train), rows)
        return rows


def flatten(node: Any, rows: NDArray[np.float32]) -> None:
    """Write a node of the library and all below it into `rows` [nodes, 12], pre-order."""
    rows[0] = [float(feature) for feature in node[:N_NODE_FEATURES]]
    size = len(rows) >> 2
    for turn, child in enumerate(node.childs.values()):
        if isinstance(child, tuple):
            flatten(child, rows[1 + turn * size : 1 + (turn + 1) * size])
