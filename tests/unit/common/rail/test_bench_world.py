"""The benchmark compares like with like: it notices a difference, and prints what every `bench` prints."""

import json

import numpy as np
import pytest

from common.levels.legacy import generate
from common.rail import bench_world
from common.rail.compiled.world import CompiledWorld


@pytest.mark.parametrize("disturbed", [False, True])
def test_a_row_has_both_times(disturbed: bool):
    row = bench_world.compare("tiny", [generate("easy", 1)], disturbed=disturbed, steps=4, repeats=1)
    assert (row.name, row.unit, row.repeats) == ("tiny", "us/step", 1)
    assert row.ratio == pytest.approx(row.theirs / row.ours, rel=0.1)
    assert set(json.loads(json.dumps(vars(row)))) == {"name", "unit", "ours", "theirs", "ratio", "repeats"}


def test_a_difference_is_an_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(CompiledWorld, "obey", lambda _world, actions: np.zeros(actions.shape))
    with pytest.raises(bench_world.DisagreementError, match="tiny, repeat 0"):
        bench_world.compare("tiny", [generate("easy", 1)], disturbed=False, steps=4, repeats=1)
