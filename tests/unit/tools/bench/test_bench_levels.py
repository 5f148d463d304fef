"""Levels are timed only if the library finds no fault with them, and knows the same distances."""

from dataclasses import replace

import numpy as np
import pytest

from railctl.common.levels.distributions import shipped
from railctl.common.levels.legacy import generate
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.tools.bench.levels import check_rails, comparison, comparisons
from railctl.tools.bench.measuring import DisagreementError, measure

LEVEL = generate(shipped()["easy"], 1)


def test_rows_have_both_times():
    rows = measure([comparison("easy", worlds=2)], repeats=1)
    assert [(row.name, row.unit) for row in rows] == [
        ("generate easy", "ms/level"),
        ("ready easy, given", "us/level"),
        ("ready easy, drawn", "us/level"),
    ]
    assert min(number for row in rows for number in (row.ours, row.theirs)) > 0


def test_all_levels_that_ship_are_measured():
    assert [comparison.name for comparison in comparisons(worlds=1)] == [f"levels {name}" for name in shipped()]


def test_broken_rails_are_an_error():
    grid = LEVEL.grid.copy()
    grid[tuple(LEVEL.starts[0, :2])] = 0
    with pytest.raises(DisagreementError, match="the rails of easy 1 are broken"):
        check_rails(replace(LEVEL, grid=grid), "easy 1")


def test_a_train_without_a_way_is_an_error():
    nowhere = np.argwhere(LEVEL.grid == 0)[:1]
    targets = np.concatenate([nowhere, LEVEL.targets[1:]]).astype(np.int32)
    with pytest.raises(DisagreementError, match="a train of easy 1 has no way"):
        check_rails(replace(LEVEL, targets=targets), "easy 1")


def test_other_distances_are_an_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(CompiledWorld, "trees", lambda world: np.zeros((1, world.max_trains, 21, 12), np.float32))
    with pytest.raises(DisagreementError, match="the distances in easy 0"):
        comparison("easy", worlds=1).once(0)
