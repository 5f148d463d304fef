"""The benchmark of updates: both sides learn the same, and it would be seen if they did not."""

import pytest

from tools.bench.learner import CASES, Seen, comparison
from tools.bench.measuring import DisagreementError


@pytest.fixture(scope="module")
def seen():
    return Seen()


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_both_sides_learn_the_same(case, seen):
    (sample,) = comparison(case, seen, updates=4).once(1)
    assert (sample.name, sample.unit) == (case.name, "us/update")
    assert min(sample.ours, sample.theirs) > 0


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_a_side_that_learns_something_else_is_noticed(case, seen):
    def sides():
        ours, theirs = case.sides()
        return ours, lambda batch: theirs(batch) * 1.002

    with pytest.raises(DisagreementError, match=r"repeat 1: losses are"):
        comparison(case._replace(sides=sides), seen, updates=2).once(1)
