"""Deadlock avoidance in small worlds by hand; beside the original: tests/parity/test_reference_policies.py."""

import numpy as np
import pytest

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.world import MOVE_FORWARD, STOP_MOVING
from railctl.services.evaluator.references.policies import reference_policy

EAST, WEST = 1, 3
ALONG, WEST_END, EAST_END = 0x0401, 0x0004, 0x0100
GO, STAY = MOVE_FORWARD, STOP_MOVING


def line(*trains, cells=9, max_steps=30):
    """A line; each train is start column, heading, target column."""
    return Level(
        grid=np.array([[WEST_END, *[ALONG] * (cells - 2), EAST_END]], np.uint16),
        starts=np.array([[0, start, heading] for start, heading, _ in trains], np.int32),
        targets=np.array([[0, target] for _, _, target in trains], np.int32),
        max_steps=max_steps,
    )


def actions(name, level):
    """[T][N]."""
    recording = reference_policy(name, CompiledWorld(1, level.n_trains))(0, level)
    told = np.full((recording.last_step, level.n_trains), -1)
    told[recording.decisions.times, recording.decisions.trains] = recording.decisions.actions
    return told.tolist()


def test_all_that_could_depart_do_before_anybody_opposes_them():
    """Then they stand: on a single track no cell before the other is off its path."""
    told = actions("deadlock-avoidance", line((1, EAST, 7), (7, WEST, 1)))
    assert told == [[GO, GO]] + [[STAY, STAY]] * 29


def test_for_an_opposing_train_two_free_cells_are_enough_and_one_is_not():
    """The other one leaves at column 4: columns 2 and 3 are free at first, then 3 alone, until it is gone."""
    told = actions("deadlock-avoidance", line((1, EAST, 7), (7, WEST, 4)))
    assert told == [[GO, GO]] * 2 + [[STAY, GO]] * 2 + [[GO, -1]] * 5


def test_entering_prevention_lets_the_last_train_depart_first():
    level = line((1, EAST, 7), (3, EAST, 7))
    told = actions("deadlock-avoidance-entering", level)
    assert told[:2] == [[STAY, GO], [GO, GO]]
    assert actions("deadlock-avoidance", level)[0] == [GO, GO]


@pytest.mark.parametrize("name", ["deadlock-avoidance", "deadlock-avoidance-entering"])
def test_a_train_without_a_path_does_not_depart(name):
    level = line((1, EAST, 6), (6, EAST, 8))
    level.grid[0, 3], level.grid[0, 4] = EAST_END, WEST_END
    told = actions(name, level)
    assert {step[0] for step in told} == {STAY}
    assert [step[1] for step in told[:4]] == [GO, GO, GO, -1]
