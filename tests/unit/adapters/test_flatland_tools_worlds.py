"""Checkpoints of any world in flatland-rl's hands: the same episode as in ours where the rules are, else a refusal."""

import click
import numpy as np
import pytest
from flatland.envs.persistence import RailEnvPersister
from rush_levels import RUSH, rush_level
from terminal import run_here

from railctl.adapters.flatland_tools import CheckpointObservation, CheckpointPolicy, StudyRewards
from railctl.common.levels.distributions import shipped
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.player import Acting, play, player
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rules.settings import NetworkConfig
from railctl.tools.levels.export import save_pickle

SEED = 77  # of malfunctions
OBSERVATIONS = {
    "study": {"kind": "tree"},
    "plain": {"kind": "tree", "depth": 1, "features": "plain"},
    "deep": {"kind": "tree", "depth": 3},
    "repaired": {"kind": "tree", "conflicts": "repaired"},
    "global": {"kind": "global"},
    "local": {"kind": "local", "radius": 3},
    "traffic": {"kind": "traffic"},
}


def world_of(observation, decisions="cells", **levels):
    return {
        "levels": {"rush": RUSH | levels},
        "mix": {"rush": 1.0},
        "observation": observation,
        "decisions": decisions,
        "evaluation": {"levels": RUSH["held_out"]},
    }


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


def ours(level, saved):
    engine = player("compiled", saved.config.world, "stock", level.n_trains)
    return play(engine, level, Acting(saved.network, greedy=True), SEED)


def lively(checkpoint_of, world, level, network=None):
    """The episode of a random policy under which trains drive about, and which does not always say the same."""
    for seed in range(60):
        course = ours(level, checkpoint_of(world, network, seed))
        decisions = course.decisions
        if len(set(decisions.actions.tolist())) > 1 and len(np.unique(decisions.observations, axis=0)) > 10:
            return course
    raise AssertionError("no random policy does more than one thing")


def check_same(level, course, tmp_path):
    made, arrived_at, steps = run(exported(level, tmp_path))
    assert steps == course.last_step
    np.testing.assert_array_equal(arrived_at, course.arrived_at)
    decisions = course.decisions
    assert [(step, train, action) for step, train, _, action in made] == list(
        zip(decisions.times.tolist(), decisions.trains.tolist(), decisions.actions.tolist(), strict=True)
    )
    np.testing.assert_array_equal(np.array([vector for _, _, vector, _ in made]), decisions.observations)


@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_an_episode_under_stock_rules_is_ours_step_by_step(checkpoint_of, tmp_path, kind):
    level = rush_level(5)
    assert level.schedule.malfunctions.rate == RUSH["malfunctions"]["rate"]
    assert len({tuple(speed) for speed in level.schedule.speeds.tolist()}) > 1
    course = lively(checkpoint_of, world_of(OBSERVATIONS[kind]), level)
    check_same(level, course, tmp_path)


@pytest.mark.parametrize("interlocking", ["valid", "safe", "planned"])
def test_behind_an_interlocking_an_episode_is_ours_too(checkpoint_of, tmp_path, interlocking):
    """With slow trains that break down: what they were granted, and could not do yet, binds them."""
    world = world_of({"kind": "traffic"}) | {"interlocking": interlocking}
    for seed in (5, 6):
        level = rush_level(seed)
        course = lively(checkpoint_of, world, level)
        assert (course.decisions.allowed != ALL_ACTIONS).any()
        check_same(level, course, tmp_path)


@pytest.mark.parametrize("decisions", ["legacy", "always"])
def test_trains_decide_where_their_run_had_them_decide(checkpoint_of, tmp_path, decisions):
    level, tree = rush_level(5), {"kind": "tree", "depth": 1}
    course = lively(checkpoint_of, world_of(tree, decisions), level)
    check_same(level, course, tmp_path)


def test_a_recurrent_policy_remembers_as_in_training(checkpoint_of, tmp_path):
    network, level = NetworkConfig(kind="recurrent", hidden=(16, 8)), rush_level(6)
    course = lively(checkpoint_of, world_of({"kind": "tree", "depth": 1}), level, network)
    check_same(level, course, tmp_path)


def test_trains_break_down_as_the_generator_of_the_environment_says(checkpoint_of, tmp_path):
    level = rush_level(5)
    course = lively(checkpoint_of, world_of({"kind": "tree"}), level)
    broken = []
    for seed in (SEED, SEED + 1):
        env = exported(level, tmp_path, seed)
        broken.append((run(env)[2], [agent.malfunction_handler.num_malfunctions for agent in env.agents]))
    assert broken[0] != broken[1]
    assert broken[0][0] == course.last_step


def test_a_policy_of_both_rules_plays_as_under_stock_rules(checkpoint_of, tmp_path):
    level, world = rush_level(5), world_of({"kind": "tree"})
    world["levels"]["tame"] = shipped()["easy"].model_dump(mode="json")
    course = lively(checkpoint_of, world | {"mix": {"tame": 0.5, "rush": 0.5}}, level)
    check_same(level, course, tmp_path)


def test_a_global_observation_has_room_for_the_runs_levels_only(checkpoint_of, tmp_path):
    checkpoint_of(world_of({"kind": "global"}))
    smaller, larger = rush_level(5, size=[20, 20]), rush_level(5, size=[25, 22])
    assert len(run(exported(smaller, tmp_path))[0]) > 0
    with pytest.raises(click.ClickException, match=r"its grid is 25x22, and .* has room for 24x22: use levels of that"):
        run(exported(larger, tmp_path))


@pytest.mark.parametrize("kind", ["study", "plain", "repaired", "local", "traffic"])
def test_other_observations_are_made_of_levels_of_any_size(checkpoint_of, tmp_path, kind):
    saved = checkpoint_of(world_of(OBSERVATIONS[kind], size=[20, 20]))
    made, _, _ = run(exported(rush_level(5), tmp_path))
    assert {len(vector) for _, _, vector, _ in made} == {saved.config.world.n_features}


def test_a_policy_refuses_the_observations_of_another_checkpoint(checkpoint_of, tmp_path):
    checkpoint_of(world_of({"kind": "tree", "depth": 1}))
    env = exported(rush_level(5), tmp_path)
    checkpoint_of(world_of({"kind": "tree", "depth": 2}))
    with pytest.raises(click.ClickException, match="observations of 60 values for a network that takes 252: let RAIL"):
        run(env)


@pytest.mark.parametrize("kind", ["deep", "global", "local"])
def test_a_policy_of_the_old_rules_is_translated_whatever_it_sees(write_checkpoint, monkeypatch, tmp_path, kind):
    """As `test_flatland_tools` for the study's tree: all positions agree a step later."""
    path = tmp_path / "weights.safetensors"
    world = {"mix": {"easy": 1.0}, "observation": OBSERVATIONS[kind]}
    monkeypatch.setenv("RAILCTL_CHECKPOINT", str(path))
    level = LevelSupply().evaluation("easy", 4)
    for seed in range(60):
        saved = load_policy(write_checkpoint(path, NetworkConfig(hidden=(32,)), seed, world))
        engine = player("compiled", saved.config.world, "legacy", level.n_trains)
        course = play(engine, level, Acting(saved.network, greedy=True))
        if (course.arrived_at >= 0).any() and len(set(course.decisions.actions.tolist())) > 1:
            break
    _, arrived_at, _ = run(exported(level, tmp_path))
    expected = np.where(course.arrived_at >= 0, course.arrived_at + 1, -1)
    np.testing.assert_array_equal(arrived_at, expected)
    assert (arrived_at >= 0).any()


def test_the_console_commands_take_a_checkpoint_of_stock_rules(checkpoint_of, tmp_path, monkeypatch):
    level = rush_level(5)
    checkpoint_of(world_of({"kind": "local", "radius": 3}))
    save_pickle(tmp_path / "level.pkl", level)
    (tmp_path / "data").mkdir()
    where = ["--data-dir", "data", "--ep-id", "one", "--rewards", "railctl.adapters.flatland_tools.StudyRewards"]
    run_here(
        monkeypatch,
        tmp_path,
        "flatland-trajectory-generate-from-policy",
        *where,
        *("--policy", "railctl.adapters.flatland_tools.CheckpointPolicy"),
        *("--obs-builder", "railctl.adapters.flatland_tools.CheckpointObservation"),
        *("--env-path", "level.pkl", "--snapshot-interval", "0"),
        RAILCTL_CHECKPOINT=str(tmp_path / "weights.safetensors"),
    )
    evaluated = run_here(monkeypatch, tmp_path, "flatland-trajectory-evaluate", *where)
    assert "trains arrived. Expected" in evaluated.stdout
