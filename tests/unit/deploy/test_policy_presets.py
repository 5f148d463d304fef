"""The presets that learn a policy say what table 5.3 of the study says, and their rules take them."""

import pytest

from deploy.resolve import resolve
from services.learner.learning import Learning, build_trainer

TABLE = {  # learning rate, batch of the replay, replay, epochs, epochs of imitation
    ("ppo", "easy"): (0.0005, None, None, 10, None),
    ("ppo", "medium"): (0.0005, None, None, 10, None),
    ("ppo", "hard"): (0.0005, None, None, 15, None),
    ("ppor", "easy"): (0.0005, 300, 10000, 10, None),
    ("ppor", "medium"): (0.0004, 300, 10000, 10, None),
    ("ppor", "hard"): (0.0004, 300, 10000, 15, None),
    ("sil", "easy"): (0.0005, 300, 20000, 10, 10),
    ("sil", "medium"): (0.0005, 300, 30000, 10, 10),
    ("sil", "hard"): (0.0005, 300, 40000, 10, 13),
}


@pytest.mark.parametrize(("algorithm", "level"), TABLE)
def test_presets_are_those_of_the_study(algorithm, level):
    config = resolve({"algorithm": algorithm, "level": level})
    assert config.ppo is not None
    batch_size = config.sil.batch_size if config.sil else config.ppo.batch_size
    assert (
        config.ppo.learning_rate,
        batch_size,
        config.replay.capacity if config.replay else None,
        config.ppo.epochs,
        config.sil.epochs if config.sil else None,
    ) == TABLE[algorithm, level]
    assert config.network.hidden == (128, 128)
    assert config.ppo.max_gradient_norm == 0.5
    assert config.fragment_steps is None
    build_trainer(config.rule, Learning.of(config))
