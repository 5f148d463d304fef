"""Pictures of levels, with however many trains."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from railctl.common.levels.shipped import generate
from railctl.tools.levels.draw import draw


def size(path: Path) -> tuple[int, int]:
    with Image.open(path) as image:
        return image.size


def test_many_trains_stand_in_columns_beside_the_map(tmp_path: Path):
    level = generate("easy", 1)
    crowd = replace(level, starts=np.tile(level.starts, (24, 1)), targets=np.tile(level.targets, (24, 1)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        few, many = (size(draw(some, tmp_path / f"{some.n_trains}.png", "made")) for some in (level, crowd))
    assert many[1] == few[1]  # the map is as large, and no list hangs below it
    assert many[0] > few[0]


def test_a_list_that_is_too_long_is_cut_and_the_picture_stays_a_map(tmp_path: Path):
    level = generate("easy", 1)
    crowd, larger = (
        replace(level, starts=np.tile(level.starts, (times, 1)), targets=np.tile(level.targets, (times, 1)))
        for times in (100, 400)
    )
    width, height = size(draw(crowd, tmp_path / "crowd.png", "made"))
    assert (width, height) == size(draw(larger, tmp_path / "larger.png", "made"))
    assert width < 2.2 * height
