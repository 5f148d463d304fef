"""What reference policies reach on 450 recorded levels of flatland 2.2.2, and deadlock avoidance beside the original.

The recording holds every action that `DeadLockAvoidancePolicy` of flatland-baselines 4.3.0 took in flatland-rl 4.3.0
under the rules of 2.2.2 (`<group>_<settings>_actions`, [steps, trains], level after level, and `_steps`, [levels]).
Where that package is installed, some of it is recorded anew.
"""

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from railctl.common.levels import files
from railctl.common.rail.compiled.arrays import NOWHERE
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.flatland_env import LegacyActions, LevelEnv
from railctl.services.evaluator.references.planner import best_ways
from railctl.services.evaluator.references.policies import INTERLOCKINGS, reference_policy
from railctl.services.evaluator.runner import evaluate

DATA = Path(__file__).parent / "data"
LEVELS = files.load(DATA / "flatland222_levels.npz")
SETTINGS = {"defaults": "deadlock-avoidance", "entering": "deadlock-avoidance-entering"}
FIGURES = {  # mean return on easy, medium and hard
    "legacy": {
        "alone": (-0.0551, -0.0577, -0.0711),
        "planner": (-0.0568, -0.0606, -0.0751),
        "planner-replanned": (-0.0568, -0.0606, -0.0750),
        "shortest-path-planned": (-0.0602, -0.0647, -0.0852),
        "shortest-path-safe": (-0.0603, -0.0699, -0.0877),
        "deadlock-avoidance-entering": (-0.0914, -0.0962, -0.1341),
        "deadlock-avoidance": (-0.1529, -0.1663, -0.2250),
        "shortest-path": (-0.1732, -0.2750, -0.4596),
        "random": (-0.6567, -0.7600, -0.8516),
    },
    "stock": {
        "alone": (-0.0575, -0.0600, -0.0734),
        "planner": (-0.0592, -0.0630, -0.0774),
        "planner-replanned": (-0.0592, -0.0630, -0.0774),
        "shortest-path-planned": (-0.0626, -0.0671, -0.0876),
        "shortest-path-safe": (-0.0627, -0.0723, -0.0900),
        "deadlock-avoidance-entering": (-0.0938, -0.0985, -0.1365),
        "deadlock-avoidance": (-0.1552, -0.1686, -0.2272),
        "shortest-path": (-0.1754, -0.2768, -0.4610),
        "random": (-0.6070, -0.7172, -0.8275),
    },
}
DIFFICULTIES = ("easy", "medium", "hard")
LONG = (pytest.mark.slow, pytest.mark.parity)
GROUPS = [
    pytest.param(rules, difficulty, marks=LONG if rules == "stock" and difficulty != "easy" else ())
    for rules in FIGURES
    for difficulty in DIFFICULTIES
]


@cache
def score(name, difficulty, rules):
    world = CompiledWorld(1, 7, rules=rules, interlocking=INTERLOCKINGS.get(name, "off"))
    return evaluate(reference_policy(name, world), LEVELS[difficulty])


@pytest.mark.parametrize(("rules", "difficulty"), GROUPS)
@pytest.mark.parametrize("name", FIGURES["legacy"])
def test_the_figures_are_those_that_the_documents_tell(name, rules, difficulty):
    expected = FIGURES[rules][name][DIFFICULTIES.index(difficulty)]
    assert score(name, difficulty, rules).mean_return == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize(("rules", "difficulty"), GROUPS)
def test_all_trains_of_plans_arrive_and_no_policy_passes_the_bound(difficulty, rules):
    assert score("planner", difficulty, rules).all_arrived.all()
    assert score("planner-replanned", difficulty, rules).all_arrived.all()
    for name in FIGURES[rules]:
        assert (score(name, difficulty, rules).returns <= score("alone", difficulty, rules).returns).all(), name


@pytest.mark.parametrize("rules", ["legacy", "stock"])
@pytest.mark.parametrize("orders", [1, 5])
def test_plans_come_true_to_the_step(rules, orders):
    world = CompiledWorld(1, 7, rules=rules)
    for index, level in enumerate(LEVELS["hard"][:40]):
        world.load(0, level)
        ways = best_ways(0, orders, index, world.parts())
        departs, arrives = (ways != NOWHERE).argmax(1), level.max_steps - (ways[:, ::-1] != NOWHERE).argmax(1)
        recording = reference_policy("planner", world, orders=orders)(index, level)
        assert recording.arrived_at.tolist() == (arrives - 1).tolist()
        assert departs.min() == (2 if rules == "stock" else 1)
        world.load(0, level)
        for step in range(recording.last_step):
            world.obey(actions_at(recording, step)[None])
            places = np.where(arrives == step + 1, NOWHERE, ways[:, step + 1])  # who arrives is gone
            assert world.batch.trains[0]["config"].tolist() == places.tolist()


def actions_at(recording, step):
    """[N]: what trains were told, nothing after their arrival."""
    actions = np.zeros(recording.n_trains, np.int8)
    now = recording.decisions.times == step
    actions[recording.decisions.trains[now]] = recording.decisions.actions[now]
    return actions


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_deadlock_avoidance_acts_as_the_original(difficulty, settings):
    with np.load(DATA / "deadlock_avoidance_actions.npz") as file:
        steps = file[f"{difficulty}_{settings}_steps"]
        recorded = np.split(file[f"{difficulty}_{settings}_actions"], steps.cumsum()[:-1])
    play = reference_policy(SETTINGS[settings], CompiledWorld(1, 7))
    for index, (level, expected) in enumerate(zip(LEVELS[difficulty], recorded, strict=True)):
        recording = play(index, level)
        assert recording.last_step == len(expected), index
        ours = recording.decisions
        np.testing.assert_array_equal(ours.actions, expected[ours.times, ours.trains], str(index))


if find_spec("flatland_baselines"):

    @pytest.mark.filterwarnings("ignore")
    @pytest.mark.parametrize("settings", SETTINGS)
    def test_the_recording_is_what_the_original_does(settings):
        from flatland_baselines.deadlock_avoidance_heuristic.policy.deadlock_avoidance_policy import (  # noqa: PLC0415
            DeadLockAvoidancePolicy,
        )

        with np.load(DATA / "deadlock_avoidance_actions.npz") as file:
            steps, recorded = file[f"hard_{settings}_steps"], file[f"hard_{settings}_actions"]
        told = []
        for level in LEVELS["hard"][:3]:
            env = LevelEnv(level)
            legacy, original = (
                LegacyActions(env),
                DeadLockAvoidancePolicy(use_entering_prevention=settings == "entering"),
            )
            while not env.dones["__all__"]:
                actions = original.act_many(range(level.n_trains), [env] * level.n_trains)
                told.append([actions[train].value for train in range(level.n_trains)])
                legacy.step(told[-1])
        np.testing.assert_array_equal(told, recorded[: steps[:3].sum()])
