"""`railctl bench cluster` runs clusters as a user does; an exact one has to come to the episodes of one process."""

import pytest

from railctl.tools.bench.alone import Alone, Trained
from railctl.tools.bench.cluster import run_cluster
from railctl.tools.bench.measuring import DisagreementError

EPISODES = 12
OTHERS = [Trained("other", 1, 1, 0.1 * number) for number in range(EPISODES)]


@pytest.mark.slow
def test_an_exact_run_comes_to_the_same_episodes(monkeypatch):
    assert run_cluster("ppo", "easy", "3", 2, EPISODES).staleness == pytest.approx(3, abs=0.3)  # fewer at its start
    monkeypatch.setattr(Alone, "run", lambda _self: OTHERS)
    with pytest.raises(DisagreementError, match="ppo at lag 3 trained other episodes in one process"):
        run_cluster("ppo", "easy", "3", 2, EPISODES)


@pytest.mark.slow
def test_a_free_run_need_not(monkeypatch):
    monkeypatch.setattr(Alone, "run", lambda _self: OTHERS)
    row = run_cluster("ppo", "easy", "free", 2, EPISODES)
    assert row.name == "ppo easy lag free, actors 2"
    assert 0 < row.staleness <= EPISODES
