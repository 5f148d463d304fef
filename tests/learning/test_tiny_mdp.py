"""Each value method finds the optimal policy of a small world whose values are known.

Four places; an action leads somewhere in some number of steps, each of which costs 1:

    place 0: stay (1)      to 1 (1)      to 2 (5)
    place 1: to 0 (1)      to 3 (6)      to 2 (1)
    place 2: arrive (2)    to 0 (1)      stay (1)
    place 3: stay (1)      arrive (1)    to 0 (2)

So the shortest ways to arrive take 4, 3, 2 and 1 steps. From place 0 the way with the fewest decisions is not
the shortest: whoever ignores how long a transition takes chooses wrongly.
"""

import numpy as np
import pytest
import torch
from made_episodes import decided, edited
from torch import nn

from railctl.common.policy.compiled import Twin
from railctl.common.policy.modules import ModuleChooser
from railctl.common.policy.packing import Layout
from railctl.common.rules import settings_of
from railctl.common.seeding import stream_key
from railctl.services.learner.algorithms.dqn import single_observations
from railctl.services.learner.learning import Learning, build_trainer
from railctl.services.learner.textbook.dqn import Dqn
from railctl.services.learner.training import ValueTrainer

ARRIVED = 4
NEXT = ((0, 1, 2), (0, 3, 2), (ARRIVED, 0, 2), (3, ARRIVED, 0))
STEPS = ((1, 1, 5), (1, 6, 1), (2, 1, 1), (1, 1, 2))
BEST_ACTION = [1, 2, 0, 1]
STEPS_LEFT = np.array([4, 3, 2, 1])
DISCOUNT = 0.9
LIMIT, TRAINS = 12, 2
PLACES = np.eye(5, 4, dtype=np.float32) - 1  # observations in [-1, 0], as those of the railway


def act(number, twin, epsilon, *, greedy=False):
    """An episode of two trains, each in a world of its own, that choose as the real ones do.

    The limit holds until no train is under way: its last observation is of a place.
    """
    choose = twin.in_episode(epsilon, stream_key(1, number, "explore"), twin.zero_state(TRAINS), greedy=greedy)
    place = [(number + train) % 4 for train in range(TRAINS)]
    free_at = [0] * TRAINS
    decisions = []
    step = 0
    while max(free_at) > step or (step < LIMIT and set(place) != {ARRIVED}):
        for train in range(TRAINS):
            if place[train] == ARRIVED or free_at[train] > step:
                continue
            here = place[train]
            decision = choose(PLACES[here], step, train)
            decisions.append((step, train, decision, PLACES[here]))
            free_at[train] += STEPS[here][decision.action]
            place[train] = NEXT[here][decision.action]
        step += 1
    return as_episode(number, step, decisions, free_at, place)


def as_episode(number, steps, decisions, free_at, place):
    """An episode of `decisions`: (step, train, what was decided, what it saw)."""
    arrived = np.array(place) == ARRIVED
    episode = decided(
        number,
        [(step, train, decision.action, seen) for step, train, decision, seen in decisions],
        -(np.arange(steps)[:, None] < np.array(free_at)).astype(np.float32),
        np.where(arrived, np.array(free_at) - 1, -1),
        np.where(arrived[:, None], np.float32(0), PLACES[place]),
    )
    told = np.array([decision for _, _, decision, _ in decisions], np.float32).T.copy()
    return edited(episode, log_probabilities=told[1], values=told[2])


METHODS = {
    "dqn": {"target_tau": None},
    "ddqn": {},
    "dddqn": {"kind": "dueling"},
    "classic double": {"kind": "dueling", "double": True},
    "the study's double, dueling apart": {"kind": "dueling-apart", "double": "reversed"},
    "drqn": {"rule": "drqn", "kind": "recurrent", "sequence_decisions": 3},
}


def learning_of(rule, episodes, network, replay, **switches):
    dqn = {"learning_rate": 0.002, "batch_size": 32, "learn_every_steps": 2, "target_tau": 0.05} | switches
    sections = {
        "discount": DISCOUNT,
        "network": network,
        "dqn": dqn,
        "replay": {"kind": replay, "capacity": 5000},
    }
    return Learning(1, episodes, settings_of(rule).model_validate(sections), n_features=4, n_actions=3)


def learn(replay, *, episodes, act=act, rule="dqn", kind="plain", **switches):
    """The compiled twin of a network trained on so many episodes that `act` plays."""
    layout = Layout(kind, 4, 3, (32, 32))
    learning = learning_of(rule, episodes, {"hidden": layout.hidden, "kind": kind}, replay, **switches)
    trainer, twin = build_trainer(rule, learning), Twin(layout)
    for number in range(episodes):
        twin.load(trainer.weights())
        trainer.train(act(number, twin, epsilon=0.5))
    twin.load(trainer.weights())
    return twin


@pytest.mark.parametrize("replay", ["uniform", "prioritized"])
@pytest.mark.parametrize("method", METHODS)
def test_the_optimal_policy_and_its_values_are_found(method, replay):
    twin = learn(replay, episodes=400, **METHODS[method])
    values = twin.outputs(PLACES[:4])
    assert values.argmax(-1).tolist() == BEST_ACTION
    optimal = -(1 - DISCOUNT**STEPS_LEFT) / (1 - DISCOUNT)
    np.testing.assert_allclose(values.max(-1), optimal, atol=0.15)
    for number in range(4):  # along a way, too
        steps = STEPS_LEFT[[(number + train) % 4 for train in range(TRAINS)]]
        assert act(number, twin, 0.0, greedy=True).course.arrived_at.tolist() == (steps - 1).tolist()


CUES = np.array([[0, -1, -1, -1], [-1, 0, -1, -1]], np.float32)  # which way to take at the fork
FORK, ASTRAY = np.array([-1, -1, 0, -1], np.float32), np.array([-1, -1, -1, 0], np.float32)


def act_by_memory(number, twin, epsilon, *, greedy=False):
    """One train sees a cue, then a fork that looks the same whatever the cue was, and is led astray if it forgot."""
    choose = twin.in_episode(epsilon, stream_key(2, number, "explore"), twin.zero_state(1), greedy=greedy)
    seen = [CUES[number % 2], FORK]
    decisions = [(step, 0, choose(observation, step, 0), observation) for step, observation in enumerate(seen)]
    steps = 2 if decisions[1][2].action == number % 2 else 8
    if steps == 8:
        decisions.append((2, 0, choose(ASTRAY, 2, 0), ASTRAY))
    return as_episode(number, steps, decisions, [steps], [ARRIVED])


def test_a_recurrent_network_remembers_what_it_saw_before():
    twin = learn("uniform", episodes=300, act=act_by_memory, **METHODS["drqn"])
    for number in range(2):
        assert len(act_by_memory(number, twin, 0.0, greedy=True).course.rewards) == 2


def test_a_module_of_ones_own_learns_it_too():
    """By autograd, on the plain path; it acts as a module as well."""

    class Own(nn.Module):
        def __init__(self):
            super().__init__()
            self.layers = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 3))

        def forward(self, observation):
            return self.layers(observation + 0.5)

    torch.manual_seed(1)
    learning, module = learning_of("dqn", 400, {}, "uniform"), Own()
    trainer = ValueTrainer(learning, Dqn(learning.settings.dqn, module), single_observations)
    chooser = ModuleChooser(module, 4, 3, is_policy=False)
    for number in range(400):
        chooser.load(trainer.weights())
        trainer.train(act(number, chooser, epsilon=0.5))
    chooser.load(trainer.weights())
    assert chooser.outputs(PLACES[:4]).argmax(-1).tolist() == BEST_ACTION
