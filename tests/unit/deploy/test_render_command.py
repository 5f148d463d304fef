"""railctl render: what it says and writes, and what it refuses before anything is played."""

import json
import os
import re

import pytest
from command_line import complaint, railctl
from PIL import Image

from railctl.common.levels import files
from railctl.common.levels.supply import LevelSupply
from railctl.common.task import FAILED, WRONG_USAGE


@pytest.fixture(autouse=True)
def in_a_folder_without_runs(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    monkeypatch.chdir(tmp_path)


def test_two_policies_play_the_same_level_beside_each_other(tmp_path):
    options = (
        "--against",
        "pretrained/dispatch-easy",
        "--level",
        "easy",
        "--number",
        2,
        "--output",
        "both.png",
        "--json",
    )
    done = railctl("render", "shortest-path", *options)
    assert done.exit_code == 0, done.stderr
    document = json.loads(done.stdout)
    assert list(document) == ["picture", "bytes", "pictures", "episodes"]
    greedy, dispatch = document["episodes"]
    assert greedy["level"] == dispatch["level"] == {"name": "easy", "number": 2}
    assert (greedy["name"], greedy["policy"]) == ("shortest-path", "shortest-path")
    assert (dispatch["policy"], dispatch["result"]["arrived"]) == ("dispatch after 1500 episodes, greedy", 3)
    with Image.open(tmp_path / "both.png") as picture:
        assert picture.width > 1000


def test_a_level_of_a_file_is_played_and_the_film_gets_a_name(tmp_path):
    files.save(tmp_path / "some.npz", {"first": [LevelSupply().evaluation("easy", 0)]})
    done = railctl("render", "planner", "--levels", "some.npz", "--group", "first", "--fps", 20)
    assert done.exit_code == 0, done.stderr
    played, picture = done.stdout.splitlines()
    assert played.startswith("planner, the best of 50 orders, on first 0: 3 of 3 trains arrived, ")
    assert picture.startswith("picture  planner-first-0.gif  (")
    with Image.open(tmp_path / "planner-first-0.gif") as film:
        assert film.n_frames > 10


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["planer"], r"no file planer, and no run named .*did you mean the policy planner\?"),
        (["random", "--output", "film.avi"], "--output film.avi: use a name that ends with .gif, .mp4, .png"),
        (["random", "--output", "no/film.gif"], "--output no/film.gif: there is no folder .*no: make it first"),
        (["random", "--step", 3], "--step 3: a film shows all steps: add --output NAME.png, or leave it out"),
        (["random", "--fps", 3, "--output", "film.png"], "--fps 3.0: a picture shows one moment: leave it out"),
        (["random", "--index", 3], "--index 3: it is said of a file: add --levels FILE, or use --level and --number"),
        (["random", "--levels", "no.npz"], "--levels no.npz: no such file"),
        (["random", "--levels", "no.npz", "--level", "easy"], "--level easy: the level comes out of no.npz: leave it "),
        (["random", "--level", "eassy"], r"unknown level 'eassy': did you mean easy\?"),
        (["random", "--number", 1000], "--number 1000: 1000 evaluation levels of hard are kept from training: use a "),
        (["shortest-path", "--sample"], "--sample: shortest-path is no network whose actions could be drawn, "),
        (["alone", "--against", "random", "--greedy"], "--greedy: alone is no network"),
        (["shortest-path", "--draws", 3], "--draws 3: shortest-path draws nothing, leave it out"),
        (["pretrained/dispatch-easy", "--greedy", "--draws", 3], "--draws 3 and --greedy: greedy play draws nothing"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(arguments, text, tmp_path):
    line = complaint(WRONG_USAGE, "render", *arguments)
    assert re.match(f"railctl: {text}", line), line
    assert not list(tmp_path.glob("*.gif"))


def test_where_nothing_can_be_written_nothing_is_played(tmp_path, monkeypatch):
    (tmp_path / "folder.gif").mkdir()
    assert "folder.gif: it is a folder" in complaint(WRONG_USAGE, "render", "random", "--output", "folder.gif")
    monkeypatch.setattr(os, "access", lambda _path, mode: mode != os.W_OK)  # root may write anywhere
    line = complaint(FAILED, "render", "random")
    assert line == f"railctl: {tmp_path}: nothing can be written there: give --output in another folder"


def test_without_ffmpeg_there_are_no_mp4s(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    line = complaint(WRONG_USAGE, "render", "random", "--output", "film.mp4")
    assert line == "railctl: --output film.mp4: there is no ffmpeg to write it with: install ffmpeg, or write a .gif"


def test_what_the_policy_cannot_play_is_said_in_a_line(tmp_path):
    (tmp_path / "rush.yaml").write_text(
        "levels: {slow: {rules: stock, size: [25, 25], trains: 2, cities: 2, speeds: {0.5: 1}}}"
    )
    line = complaint(FAILED, "render", "planner", "-f", "rush.yaml", "--level", "slow")
    assert line.startswith("railctl: evaluation levels: slow, level 0: the planner plans for trains of speed 1")
