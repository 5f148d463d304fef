"""The legacy tree on a hand-made line; `tests/parity` compares it with recordings."""

from math import inf

import numpy as np
import pytest

from railctl.common.levels.level import Level
from railctl.common.rail.legacy_tree import LegacyTree

EAST, WEST = 1, 3
ALONG = 0x0401
WEST_END, EAST_END = 0x0004, 0x0100  # dead ends
LINE = Level(  # two trains face each other, each beyond the other's target
    grid=np.array([[WEST_END, ALONG, ALONG, ALONG, ALONG, ALONG, EAST_END]], dtype=np.uint16),
    starts=np.array([[0, 1, EAST], [0, 4, WEST]], dtype=np.int32),
    targets=np.array([[0, 5], [0, 1]], dtype=np.int32),
    max_steps=20,
)
FORWARD = 6  # the node ahead of the root; 5 nodes a subtree


def at(column: int, heading: int) -> int:
    return column * 4 + heading


def test_a_train_sees_the_one_that_comes_against_it():
    tree = LegacyTree(LINE)
    tree.update([at(1, EAST), at(4, WEST)], on_map=[True, True])
    nodes = tree.tree(0)
    assert nodes[0].tolist() == [0, 0, 0, 0, 0, 0, 4, 0, 0, 0, 1, 0]
    # own target 4 ahead, which ends the branch; train 3 ahead; the paths cross after 1 step, facing each other
    assert nodes[FORWARD].tolist() == [4, inf, 3, 1, inf, 4, 0, 0, 1, 0, 1, 0]
    assert np.isnan(np.delete(nodes, [0, FORWARD], axis=0)).all()


def test_waiting_trains_are_seen_only_below_one_that_runs_and_arrived_ones_not_at_all():
    tree = LegacyTree(LINE)
    tree.update([at(1, EAST), at(4, WEST)], on_map=[True, False])
    assert tree.tree(0)[FORWARD, [2, 7, 8, 11]].tolist() == [inf, 0, 0, 0]
    tree.update([at(1, EAST), None], on_map=[True, False])
    assert tree.tree(0)[FORWARD, 2:4].tolist() == [inf, inf]
    with pytest.raises(ValueError, match="train 1 has arrived"):
        tree.tree(1)


def test_a_dead_end_is_left_backwards_as_forward():
    tree = LegacyTree(LINE)
    tree.update([at(2, WEST), None], on_map=[True, False])
    nodes = tree.tree(0)
    assert nodes[0, 6] == 7  # two to the dead end, five back to the target
    assert nodes[FORWARD, :7].tolist() == [inf, 1, inf, inf, inf, 2, 5]  # passes the other's target
    # its way back leads through its own place, where, as in flatland, it sees itself
    assert nodes[FORWARD + 2, :9].tolist() == [7, 3, 4, inf, inf, 7, 0, 0, 1]
    assert np.isnan(np.delete(nodes, [0, FORWARD, FORWARD + 2], axis=0)).all()


def test_rails_that_lead_off_the_grid_are_refused():
    loose = Level(np.full((1, 3), ALONG, np.uint16), LINE.starts[:1], np.array([[0, 2]], np.int32), 20)
    with pytest.raises(ValueError, match="off the grid"):
        LegacyTree(loose)
