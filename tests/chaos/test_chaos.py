"""A few faults upon a real run; `make chaos` has them by the hundred."""

from collections import Counter
from types import SimpleNamespace

import campaign
import pytest
from campaign import Campaign, Findings, table
from faults import KINDS, Fault, drawn
from hanging import hung

from railctl.tools.bench.alone import Trained

SOME = [
    Fault("truncated message", "", 1, 1),
    Fault("forged heartbeat", "", 0, 3),
    Fault("newest snapshot damaged", "learner", 3, 4),
    Fault("message of another run", "", 0, 5),
    Fault("killed", "actor", 1, 6),
    Fault("garbage", "", 0, 7),
]


def test_a_run_comes_to_its_curve_whatever_happens(tmp_path):
    found = Campaign(tmp_path, "dddqn", seed=1, episodes=40, say=print).carry_out(SOME)
    assert found.clean, table(found)
    assert found.survived == len(SOME)
    assert found.episodes == 40 * found.rounds


def test_the_same_seed_draws_the_same_faults():
    faults = drawn(3, 100)
    assert faults == drawn(3, 100) != drawn(4, 100)
    assert {fault.kind for fault in faults} == set(KINDS)
    assert all(fault.target in KINDS[fault.kind][1] for fault in faults)


def test_a_changed_run_is_found(tmp_path, monkeypatch):
    made = Campaign(tmp_path, "dddqn", seed=1, episodes=3, say=print)
    run = campaign.RunFolder(tmp_path)
    rows = [SimpleNamespace(episode=episode, digest="a", steps=1) for episode in (0, 1, 1)]
    monkeypatch.setattr(campaign, "read_rows", lambda *_: rows)
    monkeypatch.setattr(campaign.RunFolder, "config", lambda _run: SimpleNamespace(episodes=3, is_free=False))
    monkeypatch.setattr(campaign, "Alone", lambda _config: Counted())
    made._compare(run)
    found = made.findings
    assert (found.lost, found.counted_twice, found.different, found.clean) == (1, 1, 1, False)
    assert found.orphans == 0


def test_a_free_run_is_compared_with_nothing_but_its_bound():
    config = SimpleNamespace(most_ahead=2)
    assert campaign.too_stale([SimpleNamespace(staleness=staleness) for staleness in (0, 2, 3, -1)], config) == 2


class Counted:
    """Another curve than the one that was found."""

    def run(self):
        return [Trained(digest, 1, 1, 0.0) for digest in ("b", "a", "a")]


def test_the_table_counts_faults_by_outcome():
    found = Findings(Counter({("killed", "went on"): 2, ("killed", "started anew"): 1}), rounds=1, episodes=5)
    assert "| killed | 2 | 1 |  |" in table(found)
    assert "3 faults survived in 1 runs of 5 episodes in all: 0 lost" in table(found)


def test_a_process_that_may_not_be_traced_does_not_hang():
    with pytest.raises(OSError, match="process 1073741824 may not be traced"), hung(2**30):
        pass
