"""The `cells` rule on a hand-made grid."""

import numpy as np

from railctl.common.rail.decisions import decision_cells

NORTH, EAST, SOUTH, WEST = range(4)
ALONG, ACROSS = 0x0401, 0x8020  # straight track, east-west and north-south
SWITCH = 0x0C11  # eastward, a train goes on or turns north; from the north and from the east it goes west
CROSSING = 0x8421


def test_trains_decide_at_a_switch_they_face_and_before_any():
    grid = np.array([[0, 0, ACROSS, 0, 0], [ALONG, ALONG, SWITCH, ALONG, ALONG]], dtype=np.uint16)
    deciding = {tuple(where) for where in np.argwhere(decision_cells(grid)).tolist()}
    assert deciding == {
        (1, 2, EAST),  # two exits
        (1, 1, EAST),  # before the switch, facing it
        (1, 3, WEST),  # before it from its single side
        (0, 2, SOUTH),  # and from its branch
    }


def test_a_crossing_counts_as_a_cell_with_many_transitions():
    grid = np.array([[0, ACROSS, 0], [ALONG, CROSSING, ALONG], [0, ACROSS, 0]], dtype=np.uint16)
    deciding = {tuple(where) for where in np.argwhere(decision_cells(grid)).tolist()}
    assert deciding == {(1, 0, EAST), (1, 2, WEST), (0, 1, SOUTH), (2, 1, NORTH)}


def test_the_border_is_empty():
    assert not decision_cells(np.array([[ALONG]], dtype=np.uint16)).any()
