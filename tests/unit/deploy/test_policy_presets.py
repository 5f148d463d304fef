"""The presets that learn a policy say what table 5.3 of the study says, and their rules take them."""

import pytest

from railctl.deploy.resolve import resolve
from railctl.services.learner.learning import build_trainer, learning_of

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
    found = config.learning.model_dump()
    ppo, sil, replay = (found.get(name, {}) for name in ("ppo", "sil", "replay"))
    assert (
        ppo["learning_rate"],
        (sil or ppo).get("batch_size"),
        replay.get("capacity"),
        ppo["epochs"],
        sil.get("epochs"),
    ) == TABLE[algorithm, level]
    assert config.learning.network.hidden == (128, 128)
    assert ppo["max_gradient_norm"] == 0.5
    assert config.learning.steps_a_fragment is None
    build_trainer(config.rule, learning_of(config))
