"""The benchmark compares like with like: it measures all levels that ship, and notices a difference."""

import numpy as np
import pytest

from railctl.common.levels.shipped import generate
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.tools.bench.measuring import DisagreementError, measure
from railctl.tools.bench.world import comparison, comparisons


@pytest.mark.parametrize("disturbed", [False, True])
def test_a_row_has_both_times(disturbed: bool):
    [row] = measure([comparison("tiny", [generate("easy", 1)], disturbed=disturbed, steps=4)], repeats=1)
    assert (row.name, row.unit, row.repeats) == ("tiny", "us/step", 1)
    assert row.ratio == pytest.approx(row.theirs / row.ours, rel=0.01)


def test_all_levels_that_ship_are_measured():
    assert [comparison.name for comparison in comparisons(worlds=1, steps=1)] == [
        "step+tree easy",
        "step+tree medium",
        "step+tree hard",
        "step+tree hard, malfunctions, speeds",
    ]


def test_a_difference_is_an_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(CompiledWorld, "obey", lambda _world, actions: np.zeros(actions.shape))
    with pytest.raises(DisagreementError, match="tiny, repeat 0"):
        measure([comparison("tiny", [generate("easy", 1)], disturbed=False, steps=4)], repeats=1)
