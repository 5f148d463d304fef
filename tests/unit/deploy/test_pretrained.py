"""The checkpoints that ship are found by name, and dispatch as well as is said of them."""

import json

import pytest
from command_line import complaint, railctl

from railctl.common.checkpoint import load
from railctl.common.config import config_of_science
from railctl.common.task import WRONG_USAGE
from railctl.deploy.commands.references import heading
from railctl.deploy.runs import PRETRAINED, find_checkpoint, pretrained

LEVELS = ("easy", "medium", "hard")


def test_there_is_one_for_each_level():
    assert pretrained() == [f"pretrained/dispatch-{level}" for level in sorted(LEVELS)]


@pytest.mark.parametrize("level", LEVELS)
def test_they_are_of_runs_of_this_version(level):
    path = find_checkpoint(f"pretrained/dispatch-{level}")
    assert path == PRETRAINED / f"dispatch-{level}.safetensors"
    _, metadata = load(path, "checkpoint")
    config = config_of_science(metadata["science"])
    assert (config.algorithm, list(config.mix), config.episodes) == ("dispatch", [level], 1500)


@pytest.mark.parametrize("level", LEVELS)
def test_all_their_trains_arrive(level, tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path))
    found = railctl("evaluate", f"pretrained/dispatch-{level}", "--episodes", 20, "--json")
    assert found.exit_code == 0, found.stderr
    document = json.loads(found.stdout)
    [row] = document["rows"]
    assert (row["levels"], row["arrived_share"]) == (20, 1)
    assert heading(document) == f"pretrained/dispatch-{level}: dispatch after 1500 episodes, greedy"


def test_what_does_not_ship_is_named():
    text = complaint(WRONG_USAGE, "evaluate", "pretrained/dispatch-hrad")
    assert text.startswith("railctl: pretrained/dispatch-hrad: no such checkpoint ships: did you mean pretrained/dis")
