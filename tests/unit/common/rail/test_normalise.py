"""Normalisation, by hand."""

from math import inf

import numpy as np
import pytest

from railctl.common.levels.distributions import Bounds
from railctl.common.rail.normalise import N_FEATURES, N_NODE_FEATURES, N_NODES, journey_cells, normalise


def tree_of(**nodes: tuple[float, ...]) -> np.ndarray:
    tree = np.full((N_NODES, N_NODE_FEATURES), np.nan)
    for name, features in nodes.items():
        tree[int(name.removeprefix("node"))] = features
    return tree


ROOT = (0, 0, 0, 0, 0, 0, 40, 0, 0, 4, 0.25, 0)
NODE = (10, inf, 50, 49, 0, 20, 30, 1, 2, 5, 0.5, 9)


def test_every_feature_by_hand():
    root, node = normalise(tree_of(node0=ROOT, node6=NODE)).reshape(N_NODES, N_NODE_FEATURES)[[0, 6]]
    # the root's distance: 40 / 100 - 1; its malfunction and speed
    assert root.tolist() == pytest.approx([0, 0, 0, 0, 0, 0, -0.6, 0, 0, -0.4, -0.75, 0])
    # 10 / 50 - 1, nothing, just out of sight, 49 / 50 - 1, here, 20 / 50 - 1, a detour of 20 + 30 - 40 = 10 cells:
    # 10 / 25 - 1, one and two of five trains, 5 of 10 steps, half speed, more than five trains ready
    assert node.tolist() == pytest.approx([-0.8, 0, 0, -0.02, -1, -0.6, -0.6, -0.2, -0.4, -0.5, -0.5, -1])


def test_plain_features_by_hand():
    vector = normalise(tree_of(node0=ROOT, node6=NODE), "plain", journey=journey_cells(Bounds(40, 60, 1)))
    root, node = vector.reshape(N_NODES, N_NODE_FEATURES)[[0, 6]]
    assert root.tolist() == pytest.approx([0, 0, 0, 0, 0, 0, 40 / 200 - 1, 0, 0, -0.4, -0.75, 0])
    assert node.tolist() == pytest.approx([-0.8, 0, 0, -0.02, -1, -0.6, 30 / 200 - 1, -0.2, -0.4, -0.5, -0.5, -1])


def test_the_study_s_grid_gives_plain_features_the_study_s_scale():
    assert journey_cells(Bounds(25, 25, 7)) == 100


def test_padding_is_positive_zero():
    vector = normalise(tree_of(node0=(0,) * 10 + (1.0, 0)))
    assert vector.shape == (N_FEATURES,)
    assert vector.dtype == np.float32
    assert vector[6] == -1  # at the target
    assert vector[np.arange(N_FEATURES) != 6].tobytes() == bytes(4 * (N_FEATURES - 1))


@pytest.mark.parametrize(
    ("branch", "remaining", "expected"),
    [
        (20, 20, -1),  # on the shortest path
        (10, 20, -1),  # shorter than the shortest: clipped
        (30, 35, 0),  # 25 cells longer
        (300, 350, 0),
        (inf, 20, 0),
        (20, inf, 0),
    ],
)
def test_a_detour_counts_from_the_shortest_path(branch: float, remaining: float, expected: float):
    tree = tree_of(node0=ROOT, node1=(inf,) * 5 + (branch, remaining, 0, 0, 0, 1, 0))
    assert normalise(tree)[N_NODE_FEATURES + 6] == expected


def test_a_train_without_a_way_sees_no_detour():
    tree = tree_of(node0=(0,) * 6 + (inf, 0, 0, 0, 1, 0), node1=(inf,) * 7 + (0, 0, 0, 1, 0))
    assert not normalise(tree).any()


def test_the_tree_is_left_as_it_was():
    tree = tree_of(node0=ROOT, node6=NODE).astype(np.float32)
    before = tree.copy()
    normalise(tree)
    np.testing.assert_array_equal(tree, before)
