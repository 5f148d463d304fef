"""The folder for flatland-rl's own evaluator: its commands find in it what they need, and the same returns as we do."""

import json
import re

from rush_levels import RUSH, rush_level
from terminal import run_command

from railctl.common.interpreter import PYTHON
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.player import Acting, play, player
from railctl.common.requests import ExportRequest
from railctl.common.rules.settings import NetworkConfig
from railctl.tools.export import flatland_folder
from railctl.tools.levels.export import save_pickle

WHOLE = {name: value for name, value in RUSH.items() if name != "malfunctions"}  # each draws breakdowns for itself
WORLD = {"levels": {"rush": WHOLE}, "mix": {"rush": 1.0}, "evaluation": {"levels": WHOLE["held_out"]}}


def test_flatlands_own_evaluator_finds_the_returns_that_we_find(write_checkpoint, tmp_path, capsys):
    levels = [rush_level(seed, malfunctions=None) for seed in (5, 6)]
    path = write_checkpoint(tmp_path / "weights.safetensors", NetworkConfig(hidden=(32,)), 3, WORLD)
    saved = load_policy(path)
    engine = player("compiled", saved.config.world, "stock", 4)
    courses = [play(engine, level, Acting(saved.network, greedy=True)) for level in levels]
    flatland_folder.make(ExportRequest(checkpoint=path, output=tmp_path / "folder"))
    said = json.loads(capsys.readouterr().out)
    assert said["files"] == ["README.md", "checkpoint.safetensors", "evaluate.py", "railctl_policy.py"]
    for number, level in enumerate(levels):
        save_pickle(tmp_path / f"level_{number}.pkl", level)
    played = run_command(tmp_path, *PYTHON, "folder/evaluate.py", "level_0.pkl", "level_1.pkl")
    assert played.returncode == 0, played.stderr
    found = [float(number) for number in re.findall(r"return +(-\d\.\d+)", played.stdout)]
    ours = [course.normalised_return for course in courses]
    assert found == [round(number, 5) for number in (*ours, sum(ours) / 2)]


def test_the_readme_says_what_differs(write_checkpoint, tmp_path):
    stock = flatland_folder.readme(load_policy(write_checkpoint(tmp_path / "a", world=WORLD)))
    legacy = flatland_folder.readme(load_policy(write_checkpoint(tmp_path / "b")))
    assert "levels/rush_0000.pkl" in stock
    assert "so returns are those of `railctl\nevaluate`" in stock
    assert "everything happens one step later" in legacy


def test_without_levels_the_script_says_how_it_is_used(tmp_path, write_checkpoint):
    path = write_checkpoint(tmp_path / "weights.safetensors")
    flatland_folder.make(ExportRequest(checkpoint=path, output=tmp_path / "folder"))
    failed = run_command(tmp_path, *PYTHON, "folder/evaluate.py", "none.pkl")
    assert (failed.returncode, failed.stderr.splitlines()[0][:30]) == (1, "usage: python evaluate.py LEVE")
