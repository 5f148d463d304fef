"""Each preset that learns a policy finds the optimal one of the small world of `test_tiny_mdp`, and its values."""

import numpy as np
import pytest
import torch
from test_tiny_mdp import ARRIVED, BEST_ACTION, DISCOUNT, LIMIT, NEXT, PLACES, STEPS, STEPS_LEFT, TRAINS, as_episode

from common.config import NetworkConfig, PpoConfig, ReplayConfig, SilConfig
from common.policy.choosing import draw_counter
from common.policy.compiled import Twin
from common.policy.packing import Layout
from common.seeding import stream_key
from services.learner.learning import Learning, build_trainer

HIDDEN = (32, 32)


@pytest.fixture(autouse=True)
def _one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def act(number, twin):
    """An episode of two trains, each in a world of its own, that choose as the actors' do."""
    key = stream_key(1, number, "explore")
    place = [(number + train) % 4 for train in range(TRAINS)]
    free_at = [0] * TRAINS
    decisions, outcomes = [], []
    step = 0
    while max(free_at) > step or (step < LIMIT and set(place) != {ARRIVED}):
        for train in range(TRAINS):
            if place[train] == ARRIVED or free_at[train] > step:
                continue
            here = place[train]
            counter = np.array([draw_counter(step, TRAINS, train)], np.uint64)
            chosen = twin.act(PLACES[here][None], np.zeros(1), np.array([key], np.uint64), counter)
            action = int(chosen.actions[0])
            decisions.append((step, train, action, here))
            outcomes.append((chosen.log_probabilities[0], chosen.outputs[0, -1]))
            free_at[train] += STEPS[here][action]
            place[train] = NEXT[here][action]
        step += 1
    log_probabilities, values = np.array(outcomes, np.float32).T.copy()
    episode = as_episode(number, step, decisions, free_at, place)
    return episode.model_copy(update={"log_probabilities": log_probabilities, "values": values})


SECTIONS = {
    "ppo": {},
    "ppor": {"replay": ReplayConfig(capacity=500)},
    "sil": {
        "replay": ReplayConfig(kind="prioritized", capacity=1000, beta=0),
        "sil": SilConfig(epochs=4, batch_size=64),
    },
}


@pytest.mark.parametrize("rule", SECTIONS)
def test_the_optimal_policy_and_its_values_are_found(rule):
    network = NetworkConfig(kind="actor-critic", hidden=HIDDEN)
    ppo = PpoConfig(learning_rate=0.003, epochs=4, batch_size=64 if rule == "ppor" else None, entropy_weight=0.001)
    sections = SECTIONS[rule]
    learning = Learning(
        seed=1, episodes=600, discount=DISCOUNT, network=network, ppo=ppo, n_features=4, n_actions=3, **sections
    )
    trainer = build_trainer(rule, learning)
    twin = Twin(Layout("actor-critic", 4, 3, HIDDEN))
    for number in range(learning.episodes):
        twin.load(trainer.weights())
        trainer.train(act(number, twin))
    twin.load(trainer.weights())
    outputs = twin.outputs(PLACES[:4])
    assert outputs[:, :3].argmax(-1).tolist() == BEST_ACTION
    np.testing.assert_allclose(outputs[:, 3], -(1 - DISCOUNT**STEPS_LEFT), atol=0.05)
