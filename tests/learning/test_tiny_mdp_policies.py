"""Each preset that learns a policy finds the optimal one of the small world of `test_tiny_mdp`, and its values."""

import numpy as np
import pytest
import torch
from test_tiny_mdp import BEST_ACTION, DISCOUNT, PLACES, STEPS_LEFT, act

from railctl.common.policy.compiled import Twin
from railctl.common.policy.packing import Layout
from railctl.common.rules import settings_of
from railctl.services.learner.learning import Learning, build_trainer

HIDDEN = (32, 32)


@pytest.fixture(autouse=True)
def _one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


PPO = {"learning_rate": 0.003, "epochs": 4, "entropy_weight": 0.001}
SECTIONS = {
    "ppo": {"ppo": PPO},
    "ppor": {"ppo": PPO | {"batch_size": 64}, "replay": {"capacity": 500}},
    "sil": {"ppo": PPO, "replay": {"capacity": 1000, "beta": 0}, "sil": {"epochs": 4, "batch_size": 64}},
}


@pytest.mark.parametrize("rule", SECTIONS)
def test_the_optimal_policy_and_its_values_are_found(rule):
    sections = SECTIONS[rule] | {"discount": DISCOUNT, "network": {"hidden": HIDDEN}}
    learning = Learning(1, 600, settings_of(rule).model_validate(sections), n_features=4, n_actions=3)
    trainer = build_trainer(rule, learning)
    twin = Twin(Layout("actor-critic", 4, 3, HIDDEN))
    for number in range(learning.episodes):
        twin.load(trainer.weights())
        trainer.train(act(number, twin, epsilon=0.0))
    twin.load(trainer.weights())
    outputs = twin.outputs(PLACES[:4])
    assert outputs[:, :3].argmax(-1).tolist() == BEST_ACTION
    np.testing.assert_allclose(outputs[:, 3], -(1 - DISCOUNT**STEPS_LEFT), atol=0.05)
