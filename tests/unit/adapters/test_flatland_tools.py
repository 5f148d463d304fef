"""flatland-rl's console commands with our checkpoints, and that trains do in them what they do in training."""

import click
import numpy as np
import pandas as pd
import pytest
from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.env_generation.env_generator import env_generator
from flatland.envs.persistence import RailEnvPersister
from flatland.envs.step_utils.states import TrainState
from terminal import run_here

from railctl.adapters.flatland_tools import (
    CheckpointObservation,
    CheckpointPolicy,
    StudyObservation,
    StudyRewards,
    TrainView,
)
from railctl.adapters.flatland_views import Signals
from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.player import Acting, play, player
from railctl.common.rail.asking import Free
from railctl.common.rail.flatland_world import FlatlandEpisode
from railctl.common.rail.normalise import N_FEATURES, normalise
from railctl.common.rail.world import MOVE_FORWARD
from railctl.common.rules.settings import NetworkConfig
from railctl.deploy.runs import find_checkpoint
from railctl.tools.levels.export import save_pickle

CLASSES = [
    *("--policy", "railctl.adapters.flatland_tools.CheckpointPolicy"),
    *("--obs-builder", "railctl.adapters.flatland_tools.StudyObservation"),
    *("--rewards", "railctl.adapters.flatland_tools.StudyRewards"),
]


@pytest.fixture
def policy_of(write_checkpoint, tmp_path, monkeypatch):
    def policy(**options):
        monkeypatch.setenv("RAILCTL_CHECKPOINT", str(write_checkpoint(tmp_path / "weights.safetensors", **options)))
        return CheckpointPolicy()

    return policy


def environment_of(level, tmp_path):
    return environment_with(StudyObservation(), level, tmp_path)


def environment_with(observation, level, tmp_path):
    save_pickle(tmp_path / "level.pkl", level)
    return RailEnvPersister.load_new(tmp_path / "level.pkl", obs_builder=observation, rewards=StudyRewards())[0]


def places_of(env):
    configurations = [agent.current_configuration for agent in env.agents]
    return [None if here is None else (*map(int, here[0]), int(here[1])) for here in configurations]


def run(env, policy):
    """The trains' places after every step, [T] lists of N, and the sum of all rewards."""
    views = env._get_observations()
    places, rewards = [], 0.0
    while not env.dones["__all__"]:
        actions = policy.act_many(env.get_agent_handles(), observations=list(views.values()))
        views, given, _, _ = env.step(actions)
        places.append(places_of(env))
        rewards += sum(given.values())
    return places, rewards


def trained(level, twin):
    """As `run`, in the world of the study."""
    episode = FlatlandEpisode(level)
    choose = twin.in_episode(0.0, 0, twin.zero_state(level.n_trains), greedy=True)
    places, rewards = [], 0.0
    while not episode.over:
        actions = [
            choose(normalise(episode.tree(train)), len(places), train).action if decides else MOVE_FORWARD
            for train, decides in enumerate(episode.deciding())
        ]
        rewards += sum(episode.step(actions))
        places.append(episode.configurations())
    return places, rewards


NETWORKS = [
    (NetworkConfig(kind="dueling"), 0),
    (NetworkConfig(hidden=(64, 32)), 2),
    (NetworkConfig(kind="dueling-apart", hidden=(64, 32)), 4),
    (NetworkConfig(kind="actor-critic"), 2),
    (NetworkConfig(kind="recurrent", hidden=(32, 16)), 3),
]


@pytest.mark.parametrize(("difficulty", "index"), [("easy", 4), ("hard", 3), ("hard", 4)])
@pytest.mark.parametrize(("network", "seed"), NETWORKS, ids=[network.kind for network, _ in NETWORKS])
def test_trains_do_as_in_training_a_step_later(policy_of, tmp_path, difficulty, index, network, seed):
    level = LevelSupply().evaluation(difficulty, index)
    policy = policy_of(network=network, seed=seed)
    places, _ = run(environment_of(level, tmp_path), policy)
    expected, _ = trained(level, load_policy(tmp_path / "weights.safetensors").network)
    assert len({str(place) for row in places for place in row}) > 20  # they drive about
    assert places[0] == [None] * level.n_trains
    assert places[1:] == expected[: len(places) - 1]
    assert len(places) == min(level.max_steps, len(expected) + 1)


def test_a_policy_plays_one_episode_after_the_other(policy_of, tmp_path):
    policy = policy_of(network=NetworkConfig(kind="recurrent", hidden=(32, 16)), seed=1)
    level = LevelSupply().evaluation("easy", 4)
    first, second = (run(environment_of(level, tmp_path), policy) for _ in range(2))
    assert first == second


def test_the_rewards_are_the_studys_for_a_step_more(policy_of, tmp_path):
    level = LevelSupply().evaluation("easy", 4)
    env = environment_of(level, tmp_path)
    _, rewards = run(env, policy_of(seed=2))
    arrived = [agent.state == TrainState.DONE for agent in env.agents]
    assert any(arrived)
    assert not all(arrived)
    _, expected = trained(level, load_policy(tmp_path / "weights.safetensors").network)
    assert rewards == expected - sum(arrived)  # the step limit takes the others' last step
    assert StudyRewards().normalize(-3.0, -1.0, num_agents=2, max_episode_steps=4) == -0.5


def test_it_plays_levels_with_slow_trains_timetables_and_malfunctions(policy_of):
    env, _, _ = env_generator(
        n_agents=5,
        seed=5,
        malfunction_interval=30,
        obs_builder_object=StudyObservation(),
        rewards=StudyRewards(),
    )
    places, _ = run(env, policy_of())
    assert len({str(place) for row in places for place in row}) > 20
    assert any(agent.malfunction_handler.num_malfunctions for agent in env.agents)


def test_a_train_is_seen_and_decides_as_the_study_says(tmp_path):
    level = LevelSupply().evaluation("easy", 0)
    env = environment_of(level, tmp_path)
    waiting = env._get_observations()[0]
    assert (waiting.step, waiting.place, waiting.deciding, waiting.broken) == (0, None, False, False)
    ready = env.step({})[0][0]
    assert (ready.step, ready.place, ready.deciding) == (1, None, True)
    np.testing.assert_array_equal(ready.vector, normalise(FlatlandEpisode(level).tree(0)))
    assert env.obs_builder.get(1).step == 1


def test_a_policy_refuses_other_observations_and_environments(policy_of, tmp_path):
    env = environment_of(LevelSupply().evaluation("easy", 0), tmp_path)
    env.obs_builder = DummyObservationBuilder()
    with pytest.raises(click.ClickException, match=r"needs --obs-builder railctl\.adapters"):
        run(env, policy_of())
    env.obs_builder = StudyObservation()
    env.obs_builder.reset(env)
    env.remove_agents_at_target = False
    with pytest.raises(click.ClickException, match="not supported: trains stay on the map at their targets"):
        run(env, policy_of())


def drop(tensors, metadata):
    del tensors["hidden.0.bias"]


def widen(tensors, metadata):
    tensors["hidden.0.weight"] = np.zeros((128, 60), np.float32)


def silence(tensors, metadata):
    metadata["science"] = "{}"


@pytest.mark.parametrize(("name", "index"), [("easy", 4), ("hard", 3)])
def test_behind_an_interlocking_trains_do_as_in_training_a_step_later(monkeypatch, tmp_path, name, index):
    path = find_checkpoint(f"pretrained/dispatch-{name}")
    monkeypatch.setenv("RAILCTL_CHECKPOINT", str(path))
    level, saved = LevelSupply().evaluation(name, index), load_policy(path)
    assert saved.config.world.interlocking == "planned"
    engine = player("compiled", saved.config.world, "legacy", level.n_trains)
    course = play(engine, level, Acting(saved.network, greedy=True))
    assert (course.arrived_at >= 0).all()
    env = environment_with(CheckpointObservation(), level, tmp_path)
    places, rewards = run(env, CheckpointPolicy())
    arrivals = [agent.arrival_time for agent in env.agents]
    assert arrivals == [step + 2 for step in course.arrived_at]  # counted from 1, and one step later
    assert len(places) == course.last_step + 1
    paid = rewards / level.n_trains / level.max_steps
    assert paid == pytest.approx(course.normalised_return - 1 / level.max_steps)


def empty(tensors, metadata):
    tensors.clear()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (drop, "tensor hidden.0.bias is missing"),
        (widen, r"tensor hidden.0.weight has shape \(128, 60\), not \(128, 252\)"),
        (silence, r"does not say what it needs of its run \(rule is missing"),
        (empty, "tensor hidden.0.weight is missing"),
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused_in_a_line(write_checkpoint, tmp_path, spoil, message):
    path = write_checkpoint(tmp_path / "weights.safetensors")
    tensors, metadata = checkpoint.load(path, "checkpoint")
    metadata = {name: metadata[name] for name in ("science", "episode")}
    spoil(tensors, metadata)
    checkpoint.save(path, tensors, metadata, "checkpoint")
    with pytest.raises(CheckpointError, match=message) as caught:
        load_policy(path)
    assert "\n" not in str(caught.value)


def test_the_console_commands_generate_and_evaluate_a_trajectory(write_checkpoint, tmp_path, monkeypatch):
    level = LevelSupply().evaluation("easy", 4)
    save_pickle(tmp_path / "level.pkl", level)
    path = write_checkpoint(tmp_path / "weights.safetensors")
    (tmp_path / "data").mkdir()
    where = ["--data-dir", "data", "--ep-id", "one"]
    run_here(
        monkeypatch,
        tmp_path,
        "flatland-trajectory-generate-from-policy",
        *where,
        *CLASSES,
        *("--env-path", "level.pkl", "--snapshot-interval", "0"),
        RAILCTL_CHECKPOINT=str(path),
    )
    logs = tmp_path / "data" / "event_logs"
    table = pd.read_csv(logs / "TrainMovementEvents.trains_rewards_dones_infos.tsv", sep="\t")
    expected, _ = trained(level, load_policy(path).network)
    assert table["env_time"].max() == min(level.max_steps, len(expected) + 1)
    assert len(table) == table["env_time"].max() * level.n_trains
    arrivals = pd.read_csv(logs / "TrainMovementEvents.trains_arrived.tsv", sep="\t")
    normalised = table["reward"].sum() / level.n_trains / level.max_steps
    assert arrivals["normalized_reward"].item() == pytest.approx(normalised)
    evaluated = run_here(monkeypatch, tmp_path, "flatland-trajectory-evaluate", *where, *CLASSES[-2:])
    assert f"{arrivals['success_rate'].item() * 100}% trains arrived" in evaluated.stdout


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no.safetensors: no such file: check the path and the run's folder"),
        (
            b"no checkpoint",
            "no.safetensors: not a safetensors file: it is truncated or of another program, use another",
        ),
    ],
)
def test_a_bad_checkpoint_is_one_line_on_the_terminal(tmp_path, monkeypatch, content, message):
    save_pickle(tmp_path / "level.pkl", LevelSupply().evaluation("easy", 0))
    if content is not None:
        (tmp_path / "no.safetensors").write_bytes(content)
    (tmp_path / "data").mkdir()
    arguments = ["--data-dir", "data", *CLASSES, "--env-path", "level.pkl"]
    command = (tmp_path, "flatland-trajectory-generate-from-policy", *arguments)
    failed = run_here(monkeypatch, *command, code=1, RAILCTL_CHECKPOINT="no.safetensors")
    assert failed.stderr.splitlines()[-1].startswith(f"Error: {message}")


def test_without_a_checkpoint_the_policy_says_what_to_set(monkeypatch):
    monkeypatch.delenv("RAILCTL_CHECKPOINT", raising=False)
    with pytest.raises(click.ClickException, match="RAILCTL_CHECKPOINT is not set"):
        CheckpointPolicy()


class OneTrain(Signals):
    """A train that is free."""

    def ask(self, deciding):
        return Free(deciding)

    def unasked(self):
        return [MOVE_FORWARD]

    def note(self, actions, deciding):
        pass


def test_views_of_no_train_are_no_episode(policy_of):
    seen = {"ways": (False,) * 5, "vector": np.zeros(N_FEATURES, np.float32), "signals": OneTrain()}
    view = TrainView(0, None, deciding=False, broken=False, **seen)
    assert len(policy_of().act_many([0], [view])) == 1
