"""The plain loop plays and learns as ours does; rates are compared where both did, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import export_parameters
from railctl.common.policy.player import Acting, network_layout, play
from railctl.common.rail.normalise import N_FEATURES
from railctl.common.records.acting import Circumstances, Fragment, Lease
from railctl.common.records.course import Course
from railctl.deploy.resolve import resolve
from railctl.services.learner.replay.transitions import TransitionMaker
from railctl.tools.bench import plain_training
from railctl.tools.bench.conditions import study_rollouts
from railctl.tools.bench.loop import Training, samples
from railctl.tools.bench.measuring import DisagreementError
from railctl.tools.bench.plain_training import PlainTraining, Trained
from railctl.tools.bench.policy import NETWORK, pathfinder

EVERY = 30


def config(**dqn: float):
    return resolve({"algorithm": "dddqn", "mix": {"easy": 1.0}, "episodes": 4, "dqn": dqn})


def played(level: Level) -> Course:
    twin = Twin(network_layout(NETWORK, N_FEATURES))
    twin.load(export_parameters(pathfinder()))
    return play(study_rollouts(), level, Acting(twin, 0.2, 7))


def transitions(course: Course) -> dict[str, np.ndarray]:
    lease = Lease(episode=0, level="easy", level_seed=0, weights_version=0, epsilon=0.0, steps=None, progressed=None)
    fragment = Fragment(lease=lease, course=course, circumstances=Circumstances(actor="any", acting_s=0, waited_s=0))
    return TransitionMaker(config().learning.discount).take(fragment).columns


@pytest.mark.parametrize("max_steps", [60, 412])
def test_the_same_actions_give_the_transitions_of_ours(monkeypatch: pytest.MonkeyPatch, max_steps: int):
    level = replace(generate("easy", 2), max_steps=max_steps)
    course = played(level)
    given = iter(course.decisions.actions.tolist())
    monkeypatch.setattr(plain_training, "choose", lambda _network, seen, *_: [next(given) for _ in seen])
    plain = PlainTraining(config())
    trained = plain.train(level)
    assert (trained.steps, trained.decisions) == (course.last_step, len(course.decisions))
    columns = transitions(course)
    ours = zip(*(columns[name].tolist() for name in ("action_tm1", "reward_t", "discount_t")), strict=True)
    theirs = [(one.action_tm1, one.reward_t, one.discount_t) for one in plain.replay]
    assert np.allclose(sorted(theirs), sorted(ours), rtol=1e-5)
    arrived = [one for one in plain.replay if one.discount_t == 0]
    assert len(arrived) == np.count_nonzero(course.arrived_at >= 0)
    assert not any(one.observation_t.any() for one in arrived)


def test_updates_fall_due_across_episodes_once_there_is_a_batch():
    plain = PlainTraining(config(batch_size=4, learn_every_steps=40))
    before = export_parameters(plain.network)
    trained = [plain.train(replace(generate("easy", seed), max_steps=50)) for seed in range(3)]
    steps = [one.steps for one in trained]
    assert [step % 40 for step in steps] != [0, 0, 0]
    assert [one.updates for one in trained] == np.diff([0, *np.cumsum(steps) // 40]).tolist()
    assert all((one.learning_s > 0) == (one.updates > 0) for one in trained)
    assert any((before[name] != now).any() for name, now in export_parameters(plain.network).items())


def test_the_replay_forgets_the_oldest(monkeypatch: pytest.MonkeyPatch):
    own = resolve({"algorithm": "dddqn", "mix": {"easy": 1.0}, "dqn": {"batch_size": 8}, "replay": {"capacity": 8}})
    plain = PlainTraining(own)
    decisions = plain.train(generate("easy", 2)).decisions
    assert decisions > 8
    assert len(plain.replay) == 8


def side(step_s: float, learning_s: float, updates: tuple[int, ...] = (0, 1, 2, 2)) -> Training:
    """Four episodes of 60 steps and 10 decisions."""
    made = [
        Trained(5 + 60 * step_s * (1 + number), 60, 10, due, due * learning_s) for number, due in enumerate(updates)
    ]
    return Training(made, wall_s=1 + made[-1].at_s - 5)


def test_rates_are_those_after_the_first_update():
    found = samples("any", side(0.01, 0.002), side(0.1, 0.008), EVERY)
    assert [(one.name, one.unit) for one in found] == [
        ("any, steps", "steps/s"),
        ("any, decisions", "decisions/s"),
        ("any, episodes", "episodes/s"),
        ("any, update", "ms/update"),
        ("any, whole run", "s"),
    ]
    assert np.allclose([one.ours for one in found], [100, 100 / 6, 100 / 60, 2, 3.4])
    assert np.allclose([one.theirs for one in found], [10, 10 / 6, 10 / 60, 8, 25])


@pytest.mark.parametrize(
    ("updates", "text"),
    [
        ((0, 1, 2, 5), "there were 7 updates in 120 steps, one every 30 is due"),
        ((0, 0, 0, 2), "no episode is left after the first that learned: use more episodes"),
        ((0, 0, 0, 0), "the replay never held a batch: use more episodes"),
    ],
)
def test_other_work_is_an_error(updates, text):
    with pytest.raises(DisagreementError, match=text):
        samples("any", side(0.01, 0.002), side(0.1, 0.008, updates), EVERY)
