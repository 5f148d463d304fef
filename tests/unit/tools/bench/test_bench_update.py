"""The benchmark of updates: both sides learn the same, and it would be seen if they did not."""

from dataclasses import replace

import pytest

from railctl.services.learner.learning import build_trainer
from railctl.tools.bench import learner_episodes
from railctl.tools.bench.learner import CASES, Seen, comparison
from railctl.tools.bench.learner_episodes import SIZES, episode_comparison
from railctl.tools.bench.measuring import DisagreementError


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


@pytest.mark.parametrize("name", SIZES)
def test_both_sides_train_on_an_episode(name, seen):
    (sample,) = episode_comparison(name, 85, seen.rows).once(1)
    assert (sample.name, sample.unit) == (f"{name} episode, 85 decisions", "us/episode")
    assert min(sample.ours, sample.theirs) > 0


def test_an_episode_that_taught_something_else_is_noticed(seen, monkeypatch):
    monkeypatch.setattr(learner_episodes, "by_torch", lambda rule, own: build_trainer(rule, replace(own, seed=2)))
    with pytest.raises(DisagreementError, match="ppo episode, 85 decisions: metrics are"):
        episode_comparison("ppo", 85, seen.rows).once(1)
