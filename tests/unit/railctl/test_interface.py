"""`import railctl`: light, and each function does what it says, or says in a line why not."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import railctl
from railctl.adapters.pettingzoo_env import TrainsEnv
from railctl.common.folder import RunFolder
from railctl.common.interpreter import PYTHON
from railctl.common.policy.checkpoints import load_policy
from railctl.common.rules.settings import NetworkConfig
from railctl.deploy.cli import app


def test_importing_it_imports_nothing_of_ours_and_nothing_heavy():
    code = "import sys; before = set(sys.modules); import railctl; print(*(set(sys.modules) - before))"
    done = subprocess.run([*PYTHON, "-c", code], capture_output=True, text=True, check=True)
    found = done.stdout.split()
    assert [name for name in found if name.startswith("railctl")] == ["railctl"]
    assert not {"numpy", "pydantic", "typer", "yaml", "numba", "torch"} & set(found)


def test_every_name_is_there_and_no_other():
    assert all(hasattr(railctl, name) for name in railctl.__all__)
    assert set(railctl.__all__) <= set(dir(railctl))
    with pytest.raises(AttributeError, match="module railctl has no attribute nope"):
        _ = railctl.nope


def test_a_policy_takes_the_best_action_that_is_allowed(write_checkpoint, tmp_path):
    path = write_checkpoint(tmp_path / "weights.safetensors")
    policy, twin = railctl.load_policy(path), load_policy(path).network
    rows = -np.random.default_rng(1).random((20, policy.n_features), np.float32)
    outputs = twin.outputs(rows)
    np.testing.assert_array_equal(policy.outputs(rows), outputs)
    np.testing.assert_array_equal(policy.act(rows), outputs.argmax(-1))
    allowed = np.zeros((20, 5), bool)
    allowed[:, 1:3] = True
    np.testing.assert_array_equal(policy.act(rows, allowed), 1 + outputs[:, 1:3].argmax(-1))


def test_a_recurrent_policy_remembers_what_its_agents_saw(write_checkpoint, tmp_path):
    path = write_checkpoint(tmp_path / "weights.safetensors", NetworkConfig(kind="recurrent", hidden=(16, 8)))
    policy, twin = railctl.load_policy(path), load_policy(path).network
    rng, memory, state = np.random.default_rng(1), {}, twin.zero_state(1)
    infos = {agent: {"deciding": agent == "b", "action_mask": np.ones(5, np.int8)} for agent in "ab"}
    for _ in range(3):
        seen = {agent: -rng.random(policy.n_features, np.float32) for agent in "ab"}
        expected = int(twin.outputs(seen["b"][None], state).argmax())
        assert policy.actions(seen, infos, memory) == {"b": expected}
    np.testing.assert_array_equal(memory["b"], state)
    assert list(memory) == ["b"]


@pytest.mark.parametrize("state", [[[0.0]], np.zeros((1, 8)), np.broadcast_to(np.float32(0), (1, 8))])
def test_a_state_that_cannot_be_carried_on_is_refused(write_checkpoint, tmp_path, state):
    policy = railctl.load_policy(write_checkpoint(tmp_path / "any.safetensors"))
    with pytest.raises(ValueError, match="give a float32 array that can be written"):
        policy.act(np.zeros((1, policy.n_features)), state=state)


@pytest.mark.parametrize(
    ("fill", "allowed", "text"),
    [
        (np.nan, None, "observations hold nan"),
        (0, np.ones((1, 5)), r"allowed has shape \(1, 5\), not \(3, 5\)"),
        (0, [[1] * 5, [0] * 5, [1] * 5], "allowed leaves a train nothing to do"),
    ],
)
def test_what_no_train_can_act_on_is_refused(write_checkpoint, tmp_path, fill, allowed, text):
    policy = railctl.load_policy(write_checkpoint(tmp_path / "any.safetensors"))
    observations = np.zeros((3, policy.n_features), np.float32)
    observations[1, 7] = fill
    with pytest.raises(ValueError, match=text):
        policy.act(observations, allowed)


@pytest.mark.parametrize("infos", [{}, {"train_0": {}}, None])
def test_observations_without_their_infos_are_refused(write_checkpoint, tmp_path, infos):
    policy = railctl.load_policy(write_checkpoint(tmp_path / "any.safetensors"))
    for observations in ({"train_0": np.zeros(policy.n_features, np.float32)}, None if infos is None else {"other": 0}):
        with pytest.raises(ValueError, match="infos are not those of the observations: give both"):
            policy.actions(observations, infos)


def test_a_policy_drives_the_world_that_it_knows():
    policy = railctl.load_policy("pretrained/dispatch-easy")
    env = railctl.make_env(policy, render_mode="rgb_array")
    assert (env.world, env.level) == (policy.config.world, None)
    observations, infos = env.reset(seed=1)
    while env.agents:
        observations, _, _, _, infos = env.step(policy.actions(observations, infos))
    assert next(iter(infos.values()))["normalised_return"] > -0.1
    assert env.render().shape == (700, 700, 3)


def test_a_world_is_that_of_levels_of_a_run_file_or_of_settings(tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text(
        "mix: {medium: 0.5, mine: 0.5}\nlevels: {mine: {rules: stock, size: [30, 30], trains: 2, cities: 2}}"
    )
    assert isinstance(railctl.make_env(), TrainsEnv)
    assert len(railctl.make_env("hard").possible_agents) == 7
    assert len(railctl.make_env(file).possible_agents) == 5
    assert len(railctl.make_env(str(file), level="mine").possible_agents) == 2
    world = railctl.make_env("easy", observation={"kind": "tree", "depth": 1}, decisions="always").world
    assert (world.n_features, world.decisions, list(world.levels)) == (60, "always", ["easy"])
    policy = railctl.load_policy("pretrained/dispatch-easy")
    assert len(railctl.make_env(policy, level="medium").possible_agents) == 5


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (lambda: railctl.load_policy("nix"), "no file nix, and there are no runs|no file nix, and no run"),
        (lambda: railctl.load_policy("pretrained/dispatch-hrad"), "no such checkpoint ships: did you mean"),
        (lambda: railctl.make_env("esy"), "unknown level 'esy': did you mean easy"),
        (lambda: railctl.make_env(obs="tree"), "unknown setting 'obs': known are"),
        (lambda: railctl.make_env("run.yaml", decisions="always"), "run.yaml says what the world is: leave decisions"),
        (lambda: railctl.evaluate("planner", mode="greedy"), "--greedy: planner is no network"),
        (lambda: railctl.evaluate("random", "easy", 0), "episodes: input should be greater than or equal to 1, not 0"),
        (lambda: railctl.open_run("nix"), "no run named 'nix'"),
        (lambda: railctl.open_run("a" * 5000), "aaa...: File name too long: give another name or path"),
        (lambda: railctl.load_policy("a" * 5000), "aaa...: File name too long: give another name or path"),
        (lambda: railctl.train(name=5), "name=5: give text"),
        (lambda: railctl.evaluate("pretrained/dispatch-easy", mode="best"), "mode: "),
        (lambda: railctl.evaluate("random", levels="mine.npz", seed=3), "levels='mine.npz': .* leave out episodes, "),
        (lambda: railctl.evaluate("random", levels="mine.npz", run_file="a.yaml"), "levels='mine.npz': the file says"),
        (lambda: railctl.make_env("easy", level="hard"), "level='hard': levels are named by where='easy' already"),
        (lambda: railctl.make_env("easy", level=""), "level='': levels are named by where='easy' already"),
        (lambda: railctl.make_env("run.yaml", level=[]), r"level=\[\]: give text"),
        (lambda: railctl.evaluate("random", level=""), "unknown level '': known are easy, hard, medium"),
        (lambda: railctl.evaluate("random", level=[]), r"level=\[\]: give text"),
        (lambda: railctl.evaluate("random", level=3), "level=3: give text"),
        (lambda: railctl.evaluate("random", run_file=3), "run_file=3: give the path of a file"),
        (lambda: railctl.evaluate("random", levels=3), "levels=3: give the path of a file"),
        (lambda: railctl.train(run_file=3), "run_file=3: give the path of a file"),
        (lambda: railctl.train(run_file="nix.yaml"), "nix.yaml cannot be read: .*: give an existing YAML file$"),
        (lambda: railctl.Run(RunFolder(Path("any"))).curve(0), "window=0: use a number of episodes, 1 or more"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, monkeypatch, wrong, text):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path))
    with pytest.raises(railctl.ConfigError, match=text) as caught:
        wrong()
    assert "\n" not in str(caught.value)


def test_an_evaluation_has_the_figures_of_the_command_line(tmp_path, monkeypatch, write_checkpoint):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path))
    path = write_checkpoint(tmp_path / "weights.safetensors")
    result = railctl.evaluate(path, "easy", 3)
    said = CliRunner().invoke(app, ["evaluate", str(path), "--level", "easy", "--episodes", "3", "--json"])
    [row] = json.loads(said.stdout)["rows"]
    assert result.returns.tolist() == row["returns"]
    assert (result.mean_return, result.low, result.arrived_share) == (row["mean"], row["low"], row["arrived_share"])
    assert result.mode == "greedy"
