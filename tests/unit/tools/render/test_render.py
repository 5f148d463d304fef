"""Episodes drawn: what is where, that shapes alone tell trains apart, and films of several formats."""

import json
import os
from itertools import combinations

import numpy as np
import pytest
from PIL import Image

from railctl.common.playback import (
    ARRIVED,
    BROKEN,
    JAMMED,
    LATE,
    MOVING,
    STOPPED,
    WAITING,
    Playback,
    PlayedLevel,
    PlayedResult,
    PlayedTrain,
)
from railctl.common.requests import RenderRequest
from railctl.common.strict import ConfigError
from railctl.common.task import FAILED, carry_out
from railctl.tools.render.films import LAST_S, FilmError
from railctl.tools.render.scene import SHOWN_STILL, Scene
from railctl.tools.render.task import render

STRAIGHT = 0b0000_0100_0000_0001  # east to east, west to west
WEST_END, EAST_END = 0b0000_0000_0000_0100, 0b0000_0001_0000_0000
GRID = [[0] * 6, [WEST_END, *[STRAIGHT] * 4, EAST_END], [0] * 6]


def playback(moments, target=(1, 5), max_steps=40):
    """An episode of train 0, which starts in the west, and train 1, which waits in the east for ever."""
    trains = [
        PlayedTrain(start=start, target=to, speed=1.0, departs=None, due=None)
        for start, to in (((1, 0, 1), target), ((1, 4, 3), (1, 1)))
    ]
    level = {"name": "line", "number": 3, "seed": 0, "file": None, "height": 3, "width": 6, "grid": GRID}
    waits = (WAITING, 1, 4, 3, 0, 0)
    result = {"return": -0.5, "arrived": 0, "trains": 2, "steps": len(moments) - 1, "score": None}
    return Playback(
        policy="any",
        level=PlayedLevel(**level, max_steps=max_steps, trains=trains, malfunctions=None),
        features=None,
        steps=[[moment, waits] for moment in moments],
        decisions=[],
        result=PlayedResult.model_validate(result),
    )


def at(column, state=MOVING, malfunction=0, flags=0):
    return (state, 1, column, 1, malfunction, flags)


ONWARD = playback([at(0, WAITING), at(0), at(1), at(2), at(3), at(4), at(5, ARRIVED)])
STANDS = playback([at(0, WAITING), at(0), at(1), *[at(1, STOPPED)] * 20])


@pytest.fixture
def rendered(tmp_path):
    """The file that is drawn of episodes."""

    def run(name, *episodes, **asked):
        paths = [tmp_path / f"{number}.json" for number in range(len(episodes))]
        for path, played in zip(paths, episodes, strict=True):
            path.write_text(played.model_dump_json(by_alias=True))
        request = {"playbacks": tuple(paths), "titles": tuple("abc"[: len(paths)]), "file": tmp_path / name}
        render(RenderRequest.model_validate(request | asked))
        return tmp_path / name

    return run


def pixels(image):
    return np.asarray(image.convert("RGB"), np.int64)


def test_moments_differ_where_trains_are():
    scene = Scene([("a", ONWARD)], 1000)
    panel = scene.panels[0]
    before, after = (pixels(panel.picture(moment)) for moment in (2, 3))
    changed = np.abs(before - after).sum(axis=2)[80:]  # below the figures
    columns = np.flatnonzero(changed.any(axis=0))
    cell = 36
    assert columns.min() >= 22 + cell
    assert columns.max() < 22 + 3 * cell + 4


def test_shapes_tell_trains_apart_without_their_colours():
    looks = [
        at(1),
        at(1, STOPPED),
        at(1, WAITING),
        at(1, BROKEN, 3),
        at(1, STOPPED, 0, JAMMED),
        at(1, MOVING, 0, LATE),
        at(1, ARRIVED),
    ]
    panel = Scene([("a", playback(looks))], 1000).panels[0]
    grey = [pixels(panel.picture(moment).convert("L"))[80:, :, 0] for moment in range(len(looks))]
    for one, other in combinations(grey, 2):
        assert (np.abs(one - other) > 60).sum() >= 20


def test_a_film_shows_every_step_and_its_last_picture_longer(rendered):
    with Image.open(rendered("film.gif", ONWARD, fps=10)) as film:
        scene = Scene([("a", ONWARD)], 1500)
        assert (film.n_frames, film.size) == (7, scene.picture(0).size)
        for moment in range(7):
            film.seek(moment)
            assert film.info["duration"] == (1000 * LAST_S if moment == 6 else 100)
            assert np.abs(pixels(film) - pixels(scene.picture(moment))).mean() < 0.5


def test_the_shorter_episode_holds_its_last_picture(rendered):
    scene = Scene([("a", ONWARD), ("b", STANDS)], 1500)
    early, late = pixels(scene.picture(6)), pixels(scene.picture(22))
    half = early.shape[1] // 2
    assert (early[:, : half - 8] == late[:, : half - 8]).all()
    assert (early[:, half:] != late[:, half:]).any()  # the number of the step


def test_stretches_in_which_nothing_happens_are_cut_short():
    scene = Scene([("a", STANDS)], 1000)
    assert scene.shown() == [0, 1, 2, 3, *range(4, 3 + SHOWN_STILL), 22]


def test_a_picture_shows_the_last_moment_with_paths_or_the_step_that_is_wanted(rendered):
    scene = Scene([("a", ONWARD)], 2600)
    with Image.open(rendered("end.png", ONWARD)) as end:
        assert (pixels(end) == pixels(scene.picture(6, with_paths=True))).all()
    assert (pixels(scene.picture(6, with_paths=True)) != pixels(scene.picture(6))).any()
    with Image.open(rendered("third.png", ONWARD, step=3)) as third:
        assert (pixels(third) == pixels(scene.picture(3, with_paths=True))).all()
    with pytest.raises(ConfigError, match=r"^--step 7: the episode ends at step 6: use that or a lower one$"):
        rendered("fourth.png", ONWARD, step=7)


def test_episodes_on_different_levels_are_refused(rendered, tmp_path):
    with pytest.raises(ConfigError, match=r"^the policies did not play the same level: "):
        rendered("film.gif", ONWARD, playback([at(0)], target=(1, 2)))
    assert not list(tmp_path.glob("*.gif*"))


def test_what_is_no_document_is_refused_in_a_line(tmp_path):
    for text in ("{}", "nonsense", json.dumps({"format": 2})):
        (tmp_path / "0.json").write_text(text)
        with pytest.raises(ConfigError, match=r"0\.json: no playback document of this version: "):
            render(RenderRequest(playbacks=(tmp_path / "0.json",), titles=("a",), file=tmp_path / "film.gif"))


@pytest.fixture
def ffmpeg(tmp_path, monkeypatch):
    """Has PATH find this script for ffmpeg; the last argument is the file that it shall write."""

    def use(script):
        folder = tmp_path / "bin"
        folder.mkdir()
        (folder / "ffmpeg").write_text(f"#!/bin/sh\nfor last; do :; done\n{script}\n")
        (folder / "ffmpeg").chmod(0o700)
        monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")

    return use


def test_ffmpeg_gets_every_picture_as_often_as_it_is_shown(rendered, ffmpeg):
    ffmpeg('cat > "$last"')
    content = rendered("film.mp4", ONWARD, fps=4).read_bytes()
    first = pixels(Scene([("a", ONWARD)], 1500).picture(0)).astype(np.uint8).tobytes()
    assert content.startswith(first)
    assert len(content) == len(first) * (6 + 4 * LAST_S)


def test_what_ffmpeg_complains_of_is_said_in_a_line(rendered, ffmpeg, tmp_path, caplog):
    ffmpeg("echo 'Unknown encoder' >&2; exit 1")
    with pytest.raises(SystemExit) as ended:
        carry_out(lambda: rendered("film.mp4", STANDS), FilmError)
    assert ended.value.code == FAILED
    assert caplog.messages == ["ffmpeg failed: Unknown encoder: write a .gif instead, or install an ffmpeg with H.264"]
    assert not list(tmp_path.glob("*film*"))
