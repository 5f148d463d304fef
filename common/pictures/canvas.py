"""The map of a level, and moments of its episodes on it; the ground is drawn once a level.

`common.pictures.glyphs` says how trains look, `common.rail.tracks` where rails lie.
"""

from collections.abc import Hashable, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from railctl.common.levels.level import Level
from railctl.common.pictures.glyphs import Sight, colour_of, draw_hatching, draw_target, draw_train, draw_waiting
from railctl.common.pictures.pen import FINER, INK, PAPER, Pen, font
from railctl.common.rail.tracks import BED, GRID_LINE, GROUND, STEEL, Line, tracks

LARGEST_CELL, SMALLEST_CELL, MOST_PIXELS = 28, 6, 1400  # of a cell's side, and of a picture's where cells allow it
RIM = 22  # pixels around a map, for the numbers of rows and columns

Picture = NDArray[np.uint8]
K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Window(NamedTuple):
    """A part of a grid: from a row and a column to before others."""

    top: int
    left: int
    bottom: int
    right: int


def cell_size(cells: int, most_pixels: int = MOST_PIXELS, largest: int = LARGEST_CELL) -> int:
    """Pixels a cell, so that so many beside each other have room."""
    return max(SMALLEST_CELL, min(largest, most_pixels // cells))


class Canvas:
    """Pictures of the episodes on one level, with so many pixels a cell; None: as there is room for."""

    def __init__(self, level: Level, cell: int | None = None) -> None:
        height, width = level.grid.shape
        self._level = level
        self.cell = cell_size(max(height, width)) if cell is None else cell
        self._ground = Image.new("RGB", (width * self.cell * FINER, height * self.cell * FINER), GROUND)
        self._draw_ground()

    def picture(self, trains: Sequence[Sight]) -> Picture:
        """[H, W, 3]: trains and their targets on the ground; H and W are the same for all pictures of a level."""
        return np.array(self.image(trains))

    def image(self, trains: Sequence[Sight], paths: Iterable[tuple[int, Line]] = ()) -> Any:
        """As `picture`, for Pillow; paths are lines [P, 2] of trains, by their numbers."""
        image = self._ground.copy()
        pen = Pen(image, FINER * self.cell)
        for number, path in paths:
            pen.line(path, colour_of(number), 0.09)
        under_way = [(number, train) for number, train in enumerate(trains) if train.place is not None]
        on_map = {train.place[:2] for _, train in under_way if train.place is not None and not train.is_waiting}
        for place in [train.place for _, train in under_way if train.is_jammed and train.place is not None]:
            draw_hatching(pen, *place[:2])
        targets: list[tuple[int, int]] = [(row, column) for row, column in self._level.targets.tolist()]
        for cell, numbers in grouped((targets[number], number) for number, _ in under_way).items():
            draw_target(pen, cell, numbers, numbered=cell not in on_map)
        waiting = [
            (train.place[:2], (number, train)) for number, train in under_way if train.place and train.is_waiting
        ]
        for cell, those in grouped(waiting).items():
            draw_waiting(pen, cell, those, numbered=cell not in on_map)
        for number, train in under_way:
            if not train.is_waiting:
                draw_train(pen, number, train)
        return image.reduce(FINER)

    def _draw_ground(self) -> None:
        draw = ImageDraw.Draw(self._ground)
        width, height = self._ground.size
        for x in range(0, width, self.cell * FINER):
            draw.line([(x, 0), (x, height)], GRID_LINE)
        for y in range(0, height, self.cell * FINER):
            draw.line([(0, y), (width, y)], GRID_LINE)
        pen = Pen(self._ground, self.cell * FINER)
        rails, stops = tracks(self._level.grid)
        for colour, share in ((BED, 0.3), (STEEL, 0.1)):
            for rail in rails:
                pen.line(rail, colour, share)
        for stop in stops:
            pen.line(stop, STEEL, 0.14)


def used_window(level: Level) -> Window:
    """The part of a level's grid that has rails, and a cell around them."""
    rows, columns = np.nonzero(level.grid)
    (height, width), none = level.grid.shape, len(rows) == 0
    if none:
        return Window(0, 0, height, width)
    bottom, right = min(height, int(rows.max()) + 2), min(width, int(columns.max()) + 2)
    return Window(max(0, int(rows.min()) - 1), max(0, int(columns.min()) - 1), bottom, right)


def with_rim(image: Any, cell: int, window: Window) -> Any:
    """A window of a map with the numbers of its columns above and its rows beside it."""
    top, left, bottom, right = window
    part = image.crop((left * cell, top * cell, right * cell, bottom * cell))
    framed = Image.new("RGB", (part.width + RIM, part.height + RIM), PAPER)
    framed.paste(part, (RIM, RIM))
    draw = ImageDraw.Draw(framed)
    every = 5 if max(bottom - top, right - left) > 12 else 1
    for column in range(left + -left % every, right, every):
        draw.text((RIM + (column - left + 0.5) * cell, RIM - 3), str(column), INK, font(11), anchor="mb")
    for row in range(top + -top % every, bottom, every):
        draw.text((RIM - 4, RIM + (row - top + 0.5) * cell), str(row), INK, font(11), anchor="rm")
    return framed


def grouped(pairs: Iterable[tuple[K, V]]) -> dict[K, list[V]]:
    """What belongs to the same key, in its order.

    >>> grouped([("a", 1), ("b", 2), ("a", 3)])
    {'a': [1, 3], 'b': [2]}
    """
    found: dict[K, list[V]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found
