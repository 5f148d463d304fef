"""Pictures of episodes, and the windows that show them."""

from itertools import pairwise

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from matplotlib import pyplot as plt
from pettingzoo.test import render_test
from pettingzoo.utils.conversions import parallel_to_aec
from rush_levels import RUSH, rush_level

from railctl.adapters.pettingzoo_env import TrainsEnv
from railctl.adapters.pictures import trains_of
from railctl.adapters.windows import NoDisplayError, Window
from railctl.common.levels.level import Level
from railctl.common.pictures.canvas import Canvas
from railctl.common.pictures.glyphs import Sight
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.world import MOVE_FORWARD
from railctl.common.world import WorldSpec

RUSH_WORLD = WorldSpec.model_validate({"levels": {"rush": RUSH}})
STRAIGHT = 0b0000_0100_0000_0001  # east to east, west to west
WEST_END, EAST_END = 0b0000_0000_0000_0100, 0b0000_0001_0000_0000


def line_level():
    """Five cells side by side, with dead ends; train 0 drives from west to east, train 1 the other way."""
    grid = np.zeros((3, 5), np.uint16)
    grid[1] = [WEST_END, STRAIGHT, STRAIGHT, STRAIGHT, EAST_END]
    starts = np.array([[1, 1, 1], [1, 3, 3]], np.int32)
    return Level(grid, starts, np.array([[1, 3], [1, 1]], np.int32), 20)


def cell(picture, row, column):
    return picture[row * 28 : row * 28 + 28, column * 28 : column * 28 + 28]


def has_colour(pixels, colour):
    rgb = [int(colour[at : at + 2], 16) for at in (1, 3, 5)]
    return bool((np.abs(pixels.astype(int) - rgb).max(axis=2) < 12).any())


def test_trains_and_targets_show_where_they_are():
    canvas = Canvas(line_level())
    on_map = Sight((1, 2, 1), is_waiting=False, is_broken=False)
    picture = canvas.picture([on_map, Sight(None, is_waiting=True, is_broken=False)])
    assert (picture.shape, picture.dtype) == ((3 * 28, 5 * 28, 3), np.uint8)
    blue, orange, red = "#0072B2", "#D55E00", "#C00000"
    assert has_colour(cell(picture, 1, 2), blue)
    assert has_colour(cell(picture, 1, 3), blue)  # its target
    assert not has_colour(picture, orange)  # train 1 has arrived
    assert not has_colour(cell(picture, 1, 0), blue)
    assert has_colour(cell(picture, 1, 0), "#3C3A36")
    assert not has_colour(cell(picture, 0, 0), "#3C3A36")
    assert not has_colour(picture, red)
    broken = canvas.picture([on_map._replace(is_broken=True), Sight((1, 4, 3), is_waiting=True, is_broken=False)])
    assert has_colour(cell(broken, 1, 2), red)
    assert has_colour(cell(broken, 1, 4), orange)


def test_an_arrow_points_where_the_train_is_heading():
    canvas = Canvas(line_level())
    east, west = (
        canvas.picture([Sight((0, 2, heading), is_waiting=False, is_broken=False), Sight(None, True, False)])
        for heading in (1, 3)
    )
    np.testing.assert_array_equal(cell(east, 0, 2).shape, (28, 28, 3))
    blue = [int("0072B2"[at : at + 2], 16) for at in (0, 2, 4)]
    columns = [np.argwhere(np.abs(seen.astype(int) - blue).max(axis=2) < 12)[:, 1].mean() for seen in (east, west)]
    assert columns[0] < columns[1]  # an arrow has most of its area at its tail


def test_trains_are_told_as_the_world_has_them():
    world = CompiledWorld(1, 3)
    world.load(0, line_level())
    assert trains_of(world) == [Sight((1, 1, 1), True, False), Sight((1, 3, 3), True, False)]
    world.step(np.full((1, 3), MOVE_FORWARD, np.int8))
    assert [train.is_waiting for train in trains_of(world)] == [False, False]
    world.step(np.full((1, 3), MOVE_FORWARD, np.int8))
    assert [train.place for train in trains_of(world)] == [(1, 2, 1), (1, 3, 3)]


def test_the_environment_draws_every_step():
    env = TrainsEnv("hard", render_mode="rgb_array")
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.render()
    env.reset(seed=1)
    pictures = [env.render()]
    while env.agents and len(pictures) < 12:
        env.step(dict.fromkeys(env.agents, 2))
        pictures.append(env.render())
    assert {picture.shape for picture in pictures} == {(700, 700, 3)}
    assert all((before != after).any() for before, after in pairwise(pictures[:8]))
    env.reset(options={"level": line_level()})
    assert env.render().shape == (84, 140, 3)
    assert TrainsEnv.metadata["render_modes"] == ["human", "rgb_array"]


def test_broken_trains_show():
    env = TrainsEnv("rush", world=RUSH_WORLD, render_mode="rgb_array")
    env.reset(seed=3, options={"level": rush_level(5, malfunctions={"rate": 1.0, "min_steps": 9, "max_steps": 9})})
    for _ in range(20):
        env.step(dict.fromkeys(env.agents, 2))
    assert has_colour(env.render(), "#C00000")


def test_large_maps_have_small_cells():
    grid = np.zeros((100, 200), np.uint16)
    grid[0, :2] = STRAIGHT
    level = Level(grid, np.array([[0, 0, 1]], np.int32), np.array([[0, 1]], np.int32), 5)
    assert Canvas(level).picture([Sight((0, 0, 1), False, False)]).shape == (700, 1400, 3)


def test_without_a_mode_rendering_warns():
    env = TrainsEnv("easy")
    env.reset(seed=1)
    with pytest.warns(UserWarning, match="there is nothing to render to"):
        assert env.render() is None


def test_without_a_display_there_is_no_window():
    with pytest.raises(NoDisplayError, match=r"there is no display, or no toolkit .*: use rgb_array"):
        TrainsEnv("easy", render_mode="human")


@pytest.fixture
def shown(monkeypatch):
    """The pictures that windows show: of a toolkit that needs no display."""
    pictures = []

    def pause(seconds):
        [image] = plt.gcf().axes[0].images
        pictures.append((np.asarray(image.get_array()), seconds))

    monkeypatch.setattr("railctl.adapters.windows.PAPER", frozenset())
    monkeypatch.setattr(plt, "pause", pause)
    yield pictures
    plt.close("all")


def test_a_window_shows_one_picture_after_the_other(shown):
    window = Window("test", 4)
    for shade in (0, 255):
        window.show(np.full((8, 9, 3), shade, np.uint8))
    window.show(np.zeros((4, 4, 3), np.uint8))
    assert [picture.shape for picture, _ in shown] == [(8, 9, 3), (8, 9, 3), (4, 4, 3)]
    assert [int(picture[0, 0, 0]) for picture, _ in shown] == [0, 255, 0]
    assert {seconds for _, seconds in shown} == {0.25}
    assert len(plt.get_fignums()) == 1
    window.close()
    window.close()
    assert plt.get_fignums() == []


def test_a_person_sees_the_start_and_every_step(shown):
    env = TrainsEnv("easy", render_mode="human")
    drawn = TrainsEnv("easy", render_mode="rgb_array")
    for played in (env, drawn):
        played.reset(seed=1)
    expected = [drawn.render()]
    for _ in range(4):
        env.step(dict.fromkeys(env.agents, 2))
        drawn.step(dict.fromkeys(drawn.agents, 2))
        expected.append(drawn.render())
    np.testing.assert_array_equal([picture for picture, _ in shown], expected)
    assert env.render() is None
    env.close()


def test_pictures_pass_pettingzoos_test_of_rendering(shown):
    def make(render_mode):
        return parallel_to_aec(TrainsEnv("easy", decisions="always", render_mode=render_mode))

    render_test(make)
