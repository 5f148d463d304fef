"""Scoring a checkpoint: which levels are played, what is said, and what is refused."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError
from railctl.common.folder import RunFolder
from railctl.common.levels import files
from railctl.common.levels.files import LevelFileError
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.player import player
from railctl.common.requests import LevelChoice, ScoreRequest
from railctl.common.rules.settings import NetworkConfig
from railctl.common.strict import ConfigError
from railctl.common.task import carry_out
from railctl.deploy.resolve import resolve
from railctl.services.evaluator.runner import UnplayableLevelError, evaluate, greedy
from railctl.services.evaluator.score import score
from railctl.services.evaluator.service import Evaluator

FIGURES = ["mean", "low", "high", "std", "median", "arrived_share", "all_arrived_share", "mean_steps", "score"]
FIGURES += ["returns"]
SUPPLY = LevelSupply()


@pytest.fixture
def weights(write_checkpoint, tmp_path):
    return write_checkpoint(tmp_path / "weights.safetensors", NetworkConfig(kind="actor-critic"), seed=1)


def request(checkpoint, mode=None, draws=None, **levels):
    return ScoreRequest(checkpoint=checkpoint, mode=mode, draws=draws, levels=LevelChoice(**levels))


def compiled(path):
    """The network of a checkpoint as it plays the levels that ship, greedily."""
    saved = load_policy(path)
    return greedy(player("compiled", saved.config.world, "legacy", 7), saved.network)


@pytest.fixture
def scored(capsys):
    """The document that is printed for this request."""

    def run(checkpoint, **asked):
        score(request(checkpoint, **asked))
        *progress, result = capsys.readouterr().out.splitlines()
        assert [list(json.loads(line)) for line in progress] == [["progress"]] * len(progress)
        return json.loads(result)

    return run


def crowded(level, n_trains):
    """The level with its trains again and again."""
    again = np.arange(n_trains) % level.n_trains
    return replace(level, starts=level.starts[again], targets=level.targets[again])


def test_every_difficulty_that_was_trained_on_is_a_row_of_the_evaluation_levels(scored, weights):
    document = scored(weights, episodes=3)
    assert list(document) == ["checkpoint", "algorithm", "episode", "mode", "draws", "rows"]
    assert list(document.values())[:5] == [str(weights), "any", 300, "greedy", None]
    assert [list(row) for row in document["rows"]] == [["level", "levels", *FIGURES]] * 2
    assert np.round(document["rows"][0]["returns"], 3).tolist() == [-0.676, -0.715, -1.0]
    policy = compiled(weights)
    for name, row in zip(("easy", "hard"), document["rows"], strict=True):
        expected = evaluate(policy, [SUPPLY.evaluation(name, index) for index in range(3)])
        assert (row["level"], row["levels"]) == (name, 3)
        assert row["returns"] == expected.returns.tolist()
        assert (row["mean"], row["mean_steps"]) == (expected.mean_return, expected.mean_steps)
        assert row["std"] == pytest.approx(np.std(row["returns"], ddof=1))
        assert row["median"] == sorted(row["returns"])[1]
        assert row["low"] <= row["mean"] <= row["high"]


def test_another_seed_is_another_sequence_of_levels(scored, weights):
    first, other = (scored(weights, names=("easy",), episodes=4, seed=seed)["rows"][0]["returns"] for seed in (0, 1))
    assert first != other
    levels = [SUPPLY.evaluation("easy", index, sequence=1) for index in range(4)]
    assert evaluate(compiled(weights), levels).returns.tolist() == other


def test_samples_repeat_and_differ_by_draws(scored, weights, tmp_path):
    files.save(tmp_path / "levels.npz", {"easy": [SUPPLY.evaluation("easy", index) for index in range(4)]})
    first, again, other = (
        scored(weights, file=tmp_path / "levels.npz", mode="sample", draws=draws) for draws in (1, 1, 2)
    )
    assert first == again
    assert (first["mode"], first["draws"], other["draws"]) == ("sample", 1, 2)
    assert first["rows"] != other["rows"]


def test_a_policy_is_scored_as_in_its_run(scored, write_checkpoint, tmp_path):
    """The row that the run's evaluator writes, and what is made of the same file later."""
    config = resolve({"algorithm": "ppo", "seed": 7, "evaluation": {"levels": 4}})
    path = tmp_path / "weights.safetensors"
    write_checkpoint(path, config.learning.network, seed=1, science=json.dumps(config.science))
    beats = SimpleNamespace(beat=lambda *_, **__: None)
    place = SimpleNamespace(
        config=config, folder=RunFolder(tmp_path), heartbeat=beats, stopping=SimpleNamespace(asked=False)
    )
    evaluator = Evaluator(place)
    tensors, metadata = checkpoint.load(path, "checkpoint")
    evaluator._network.load(tensors)
    in_run = evaluator._score(300, "easy", metadata["digest"])
    evaluator._file.close()
    document = scored(path, episodes=4)
    assert (document["mode"], document["draws"]) == (in_run.mode, 7) == ("sample", 7)
    [row] = document["rows"]
    later = [row[name] for name in ("mean", "arrived_share", "all_arrived_share", "mean_steps")]
    assert later == [in_run.normalised_return, in_run.arrived_share, in_run.all_arrived_share, in_run.mean_steps]
    assert scored(path, episodes=4, draws=8)["rows"] != [row]
    greedily = scored(path, episodes=4, mode="greedy")
    assert (greedily["mode"], greedily["draws"]) == ("greedy", None)
    assert greedily["rows"] != [row]


def test_groups_of_a_file_are_rows_whatever_their_trains(scored, weights, tmp_path):
    level = SUPPLY.evaluation("hard", 0)
    files.save(tmp_path / "levels.npz", {"jam": [crowded(level, 16)] * 2, "hard": [level]})
    jam, hard = scored(weights, file=tmp_path / "levels.npz")["rows"]
    assert (jam["level"], jam["levels"], hard["level"], hard["levels"]) == ("jam", 2, "hard", 1)
    assert (hard["low"], hard["high"], hard["std"]) == (None, None, None)
    assert hard["returns"] == [hard["mean"]] == [hard["median"]]
    assert scored(weights, file=tmp_path / "levels.npz", names=("hard",))["rows"] == [hard]


def test_more_levels_than_are_kept_from_training_are_refused(weights):
    with pytest.raises(
        ConfigError, match=r"^--episodes 1001: 1000 evaluation levels of (easy|hard) are kept from training: use no "
    ):
        score(request(weights, episodes=1001))


def test_action_values_are_not_sampled_from(write_checkpoint, tmp_path):
    path = write_checkpoint(tmp_path / "weights.safetensors")
    with pytest.raises(ConfigError, match=r"^--sample: any learns action values, .*: leave it out$"):
        score(request(path, mode="sample"))
    with pytest.raises(ConfigError, match=r"^--draws 3: greedy play draws nothing: leave it out$"):
        score(request(path, draws=3))


def test_greedy_play_draws_nothing(weights):
    with pytest.raises(ConfigError, match=r"^--draws 3: greedy play draws nothing: add --sample, or leave it out$"):
        score(request(weights, draws=3))


def test_groups_that_cannot_be_played_are_named(weights, tmp_path):
    path = tmp_path / "levels.npz"
    level = SUPPLY.evaluation("easy", 0)
    files.save(path, {"easy": [level]})
    with np.load(path) as file:
        arrays = dict(file)
    with pytest.raises(ConfigError, match=rf"^{path} has no group 'eassy': did you mean easy\? known are easy$"):
        score(request(weights, file=path, names=("eassy",)))
    np.savez(path, **{name: array[:0] for name, array in arrays.items()})
    with pytest.raises(ConfigError, match=rf"^{path}: group 'easy' holds no levels: choose another one$"):
        score(request(weights, file=path))
    off_the_grid = level.grid.copy()
    off_the_grid[0, 0] = 0b1000_0000_0010_0000  # north and south, at the upper edge
    files.save(path, {"easy": [level, replace(level, grid=off_the_grid)]})
    with pytest.raises(UnplayableLevelError, match=rf"^{path}: easy, level 1: the level's rails lead off the grid$"):
        score(request(weights, file=path))


@pytest.mark.parametrize(("science", "episode"), [("{}", "3"), ("nonsense", "3"), ('["network"]', "3")])
def test_a_checkpoint_of_another_program_is_refused_in_a_line(write_checkpoint, tmp_path, science, episode):
    path = write_checkpoint(tmp_path / "weights.safetensors", science=science, episode=episode)
    with pytest.raises(CheckpointError, match=rf"^{path}: does not say what it needs of its run"):
        load_policy(path)


def test_a_checkpoint_of_less_than_no_episodes_is_refused_in_a_line(write_checkpoint, tmp_path):
    path = write_checkpoint(tmp_path / "weights.safetensors", episode="-1")
    with pytest.raises(CheckpointError, match=rf"^{path}: .* of its run \(episode -1 is below 0\): use a checkpoint"):
        load_policy(path)


def test_what_is_wrong_with_files_ends_the_process_in_a_line(weights, tmp_path, caplog):
    content = bytearray(weights.read_bytes())
    content[-1] ^= 1
    weights.write_bytes(content)
    with pytest.raises(SystemExit) as ended:
        carry_out(lambda: score(request(weights)), CheckpointError, LevelFileError)
    assert ended.value.code == 1
    assert caplog.messages == [f"{weights}: damaged, its digest does not match its content: use another one"]
