"""What runs take is measured on a few of their own episodes and levels."""

import pytest

from railctl.deploy.resolve import resolve
from railctl.services.learner.learning import build_trainer, learning_of
from railctl.tools.bench import rates


@pytest.mark.parametrize(
    ("given", "counted"),
    [
        ({"algorithm": "ppo", "episodes": 50, "evaluation": {"mode": "sample"}}, rates.COUNTED),
        ({"algorithm": "ppo", "episodes": 4}, 2),  # as many as there are
        ({"algorithm": "ppo", "episodes": 1}, 1),
    ],
)
def test_a_run_is_measured_on_its_first_episodes(monkeypatch, tmp_path, given, counted):
    monkeypatch.setattr(rates, "COUNTED_S", 0.0)
    config = resolve(given)
    found = rates.rates(config, tmp_path)
    weights = build_trainer(config.rule, learning_of(config)).weights()
    assert (found["episodes"], found["fragments"]) == (counted, 1)
    assert found["checkpoint_bytes"] == sum(array.nbytes for array in weights.values())
    assert found["episode_s"] > 0
    assert found["level_s"] > 0
