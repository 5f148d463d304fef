"""Checkpoints of any world in flatland-rl's hands: the same episode as in ours where the rules are, else a refusal."""

import numpy as np
import pytest
from flatland.envs.persistence import RailEnvPersister
from stock_levels import RUSH, rush_level

from adapters.flatland_tools import CheckpointObservation, CheckpointPolicy, StudyRewards
from common.policy.checkpoints import load_policy
from common.policy.player import Acting, play, player
from common.rules.settings import NetworkConfig
from tools.levels.export import save_pickle

SEED = 77  # of malfunctions
OBSERVATIONS = {
    "study": {"kind": "tree"},
    "plain": {"kind": "tree", "depth": 1, "features": "plain"},
    "deep": {"kind": "tree", "depth": 3},
    "repaired": {"kind": "tree", "conflicts": "repaired"},
    "global": {"kind": "global"},
    "local": {"kind": "local", "radius": 3},
}


def world_of(observation, decisions="cells", **levels):
    rush = RUSH | levels
    return {"levels": {"rush": rush}, "mix": {"rush": 1.0}, "observation": observation, "decisions": decisions}


@pytest.fixture
def checkpoint_of(write_checkpoint, tmp_path, monkeypatch):
    def checkpoint(world, network=None, seed=4):
        path = tmp_path / "weights.safetensors"
        write_checkpoint(path, network or NetworkConfig(hidden=(32,)), seed, world)
        monkeypatch.setenv("RAILCTL_CHECKPOINT", str(path))
        return load_policy(path)

    return checkpoint


def exported(level, tmp_path, seed=SEED):
    """The level as flatland's tools load it, with the generator of an episode of ours."""
    save_pickle(tmp_path / "level.pkl", level)
    env, _ = RailEnvPersister.load_new(
        tmp_path / "level.pkl", obs_builder=CheckpointObservation(), rewards=StudyRewards()
    )
    env.np_random = np.random.RandomState(seed)
    return env


def run(env):
    """What deciding trains saw and did, [(step, train, vector, action)]; when trains arrived; steps."""
    policy, made, arrived_at = CheckpointPolicy(), [], np.full(len(env.agents), -1)
    views = env._get_observations()
    for step in range(env._max_episode_steps):
        actions = policy.act_many(env.get_agent_handles(), observations=list(views.values()))
        for train, view in views.items():
            if view.deciding:
                made.append((step, train, view.vector, actions[train].value))
        views, _, dones, _ = env.step(actions)
        for train in env.get_agent_handles():
            if dones[train] and arrived_at[train] < 0 and env.agents[train].arrival_time is not None:
                arrived_at[train] = step
        if dones["__all__"]:
            break
    return made, arrived_at, step + 1


def check_same(level, saved, tmp_path):
    made, arrived_at, steps = run(exported(level, tmp_path))
    engine = player("compiled", saved.config.world, "stock", level.n_trains)
    course = play(engine, level, Acting(saved.network, greedy=True), SEED)
    assert steps == course.last_step
    np.testing.assert_array_equal(arrived_at, course.arrived_at)
    decisions = course.decisions
    assert [(step, train, action) for step, train, _, action in made] == list(
        zip(decisions.times.tolist(), decisions.trains.tolist(), decisions.actions.tolist(), strict=True)
    )
    np.testing.assert_array_equal(np.array([vector for _, _, vector, _ in made]), decisions.observations)
    return course


@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_an_episode_under_stock_rules_is_ours_step_by_step(checkpoint_of, tmp_path, kind):
    saved = checkpoint_of(world_of(OBSERVATIONS[kind]))
    level = rush_level(5)
    assert level.schedule.malfunctions.rate == 0.01
    assert len({tuple(speed) for speed in level.schedule.speeds.tolist()}) > 1
    course = check_same(level, saved, tmp_path)
    assert len(set(course.decisions.actions.tolist())) > 1


@pytest.mark.parametrize("decisions", ["legacy", "always"])
def test_trains_decide_where_their_run_had_them_decide(checkpoint_of, tmp_path, decisions):
    few, many = rush_level(5), checkpoint_of(world_of({"kind": "tree", "depth": 1}, decisions))
    check_same(few, many, tmp_path)


def test_a_recurrent_policy_remembers_as_in_training(checkpoint_of, tmp_path):
    network = NetworkConfig(kind="recurrent", hidden=(16, 8))
    check_same(rush_level(6), checkpoint_of(world_of({"kind": "tree", "depth": 1}), network, 3), tmp_path)
