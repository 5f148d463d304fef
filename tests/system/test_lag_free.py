"""A run with `lag: free`: no curve to compare with, but nothing lost, nothing counted twice, and nothing too stale."""

import pytest

from railctl.common.locks import living
from railctl.common.records.rows import EpisodeRow, MetricRow
from railctl.common.rows import read_rows

EPISODES, BOUND = 40, 6
FREE = ("--lag", "free", "--set", f"max_staleness={BOUND}", "--actors", "easy=2")
KILLED_AFTER = {5: "actor-easy-0", 11: "learner", 18: "actor-easy-1", 25: "learner"}


@pytest.mark.parametrize("algorithm", ["ppo", pytest.param("dddqn", marks=pytest.mark.slow)])
def test_kills_lose_nothing_and_nothing_comes_too_late(clusters, tail, algorithm):
    clusters.up_any(algorithm, "--algorithm", algorithm, *FREE, "--detach")
    rows = tail(algorithm)
    for episodes, process in KILLED_AFTER.items():
        rows.until(episodes)
        clusters.kill(algorithm, process)
    rows.rest()
    folder = clusters.folder(algorithm)
    assert rows.episodes == list(range(EPISODES))
    assert rows.evaluations == [20, 40]
    assert living(folder) == {}
    trained, metrics = read_rows(folder.episodes_file, EpisodeRow), read_rows(folder.metrics_file, MetricRow)
    assert [row.episode for row in trained] == [row.episode for row in metrics] == list(range(EPISODES))
    assert [row.staleness for row in trained] == [row.episode - row.weights_version for row in trained]
    assert all(0 <= row.staleness <= BOUND for row in trained)
    assert any(row.staleness for row in trained)
    assert [row.metrics["staleness"] for row in metrics] == [row.staleness for row in trained]
    corrected = [row.metrics["clipped_ratio"] for row in metrics if "clipped_ratio" in row.metrics]
    assert len(corrected) == (EPISODES if algorithm == "ppo" else 0)
    assert all(0 < ratio <= 1 for ratio in corrected)
    assert clusters.actors(algorithm) <= {"actor-easy-0", "actor-easy-1"}
    learner = (folder.logs / "learner.log").read_text()
    assert "is not what it was before" not in learner
