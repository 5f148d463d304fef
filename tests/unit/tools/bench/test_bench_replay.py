"""All contenders give back what was put in, or there are no times."""

import numpy as np
import pytest

from railctl.tools.bench import replay
from railctl.tools.bench.measuring import DisagreementError, measure
from railctl.tools.bench.replay import RIVALS, Ours, adding, drawing, fill, memory, plain, real_transitions

CAPACITY = 400


@pytest.fixture(scope="module")
def items():
    return real_transitions(1)


@pytest.fixture(autouse=True)
def _brief(monkeypatch):
    monkeypatch.setattr(replay, "CALLS", 2)


@pytest.mark.parametrize("prioritized", [False, True])
@pytest.mark.parametrize("kind", [Ours, *RIVALS.values()])
def test_all_give_back_what_they_got(kind, prioritized, items):
    fill(kind(CAPACITY, prioritized=prioritized), items, CAPACITY, prioritized=prioritized)


def test_other_data_is_an_error(items):
    class Wrong(Ours):
        def sample(self):
            places, data, weights = super().sample()
            return places, data | {"observation_t": plain(data["observation_t"]) + 1}, weights

    with pytest.raises(DisagreementError, match="other transitions"):
        fill(Wrong(CAPACITY, prioritized=False), items, CAPACITY, prioritized=False)


def test_other_weights_are_an_error(items):
    class Wrong(Ours):
        def sample(self):
            places, data, weights = super().sample()
            return places, data, np.ones_like(weights)

    with pytest.raises(DisagreementError, match="other importance weights"):
        fill(Wrong(CAPACITY, prioritized=True), items, CAPACITY, prioritized=True)


def test_every_rival_has_a_row(items):
    rows = measure([drawing(items, CAPACITY, prioritized=True), adding(items, CAPACITY)], repeats=1)
    assert [row.name for row in rows] == [
        "prioritised sample+update, 400, cpprb",
        "prioritised sample+update, 400, numpy",
        "add 300, 400, cpprb",
        "add 300, 400, numpy",
    ]
    assert all(row.ours > 0 and row.theirs > 0 for row in rows)


def test_a_million_transitions_of_the_study_fit_in_two_gigabytes(items):
    [kept, snapshot] = measure([memory(items, 20_000)], repeats=1)
    assert kept.theirs == 2 * 252 * 4 + 1 + 4 + 4
    assert snapshot.ours < kept.ours < 500  # four times as much would still fit
