"""`railctl bench cluster` runs clusters as a user does; an exact one has to come to the episodes of one process."""

import pytest

from railctl.tools.bench.alone import Alone, Trained
from railctl.tools.bench.cluster import run_cluster
from railctl.tools.bench.launching import Case
from railctl.tools.bench.machines import NoMachinesError
from railctl.tools.bench.measuring import DisagreementError

EPISODES = 12
OTHERS = [Trained("other", 1, 1, 0.1 * number) for number in range(EPISODES)]


@pytest.mark.slow
def test_an_exact_run_comes_to_the_same_episodes(monkeypatch):
    case = Case("ppo", "easy", "3", 2)
    assert run_cluster(case, EPISODES).staleness == pytest.approx(3, abs=0.3)  # fewer at its start
    monkeypatch.setattr(Alone, "run", lambda _self: OTHERS)
    with pytest.raises(DisagreementError, match="ppo easy lag 3, actors 2 trained other episodes in one process"):
        run_cluster(case, EPISODES)


@pytest.mark.slow
def test_actors_of_other_machines_come_to_the_same_episodes():
    try:
        row = run_cluster(Case("ppo", "easy", "3", 3, machines=2), EPISODES)
    except NoMachinesError as reason:
        pytest.skip(str(reason))
    assert row.name == "ppo easy lag 3, actors 3 on 2 machines"
    assert row.staleness == pytest.approx(3, abs=0.3)


@pytest.mark.slow
def test_a_free_run_need_not(monkeypatch):
    monkeypatch.setattr(Alone, "run", lambda _self: OTHERS)
    row = run_cluster(Case("ppo", "easy", "free", 2), EPISODES)
    assert row.name == "ppo easy lag free, actors 2"
    assert 0 < row.staleness <= EPISODES
