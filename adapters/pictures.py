"""A moment of an episode as a picture: rails, trains with headings and numbers, targets with the trains' numbers.

A train on the map is an arrowhead, one that waits to depart a smaller one within a circle; a cross lies over a train
that is broken down. Targets of trains that have not arrived are square frames. The ground is drawn once a level.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.arrays import DONE, NOWHERE
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.tracks import BED, COLOURS, GRID_LINE, GROUND, STEEL, Line, arrowhead, tracks

LARGEST_CELL, SMALLEST_CELL, MOST_PIXELS = 28, 6, 1400  # of a cell's side, and of a picture's where cells allow it
FINER = 2  # drawn so many times as large, then averaged: edges become smooth

Picture = NDArray[np.uint8]


class Sight(NamedTuple):
    """What is drawn of a train.

    Attributes:
        place: row, column and heading, also while it waits to depart; None: it has arrived.
        is_waiting: it is off the map.
        is_broken: it is broken down.
    """

    place: tuple[int, int, int] | None
    is_waiting: bool
    is_broken: bool


def trains_of(world: CompiledWorld) -> list[Sight]:
    """The trains of a world's first slot."""
    batch = world.batch
    cells = batch.cells[0]
    seen = []
    for train in batch.trains[0, : batch.worlds[0]["trains"]]:
        waits = train["config"] == NOWHERE
        at = int(train["start"] if waits else train["config"])
        place = int(cells[at >> 2]["row"]), int(cells[at >> 2]["column"]), at & 3
        seen.append(Sight(None if train["state"] == DONE else place, bool(waits), bool(train["malfunction"] > 0)))
    return seen


class Canvas:
    """Pictures of the episodes on one level."""

    def __init__(self, level: Level) -> None:
        height, width = level.grid.shape
        self._level = level
        self._cell = FINER * max(SMALLEST_CELL, min(LARGEST_CELL, MOST_PIXELS // max(height, width)))
        self._ground = Image.new("RGB", (width * self._cell, height * self._cell), GROUND)
        self._draw_ground()

    def picture(self, trains: list[Sight]) -> Picture:
        """[H, W, 3]: trains and their targets on the ground; H and W are the same for all pictures of a level."""
        image = self._ground.copy()
        draw = ImageDraw.Draw(image)
        for number, train in enumerate(trains):
            if train.place is not None:
                self._draw_target(draw, number)
        for number, train in enumerate(trains):
            if train.place is not None:
                self._draw_train(draw, number, train, train.place)
        return np.array(image.reduce(FINER))

    def _draw_ground(self) -> None:
        draw = ImageDraw.Draw(self._ground)
        width, height = self._ground.size
        for x in range(0, width, self._cell):
            draw.line([(x, 0), (x, height)], GRID_LINE)
        for y in range(0, height, self._cell):
            draw.line([(0, y), (width, y)], GRID_LINE)
        rails, stops = tracks(self._level.grid)
        for colour, share in ((BED, 0.3), (STEEL, 0.1)):
            for rail in rails:
                draw.line(self._points(rail), colour, self._thickness(share), joint="curve")
        for stop in stops:
            draw.line(self._points(stop), STEEL, self._thickness(0.14))

    def _draw_target(self, draw: Any, number: int) -> None:
        row, column = self._level.targets[number].tolist()
        same = [other for other, cell in enumerate(self._level.targets.tolist()) if cell == [row, column]]
        at = same.index(number)
        inset = 0.03 + at * min(0.12, 0.4 / len(same))  # frames of several trains lie inside each other
        corners = np.array([(column + inset, row + inset), (column + 1 - inset, row + 1 - inset)])
        draw.rectangle(self._points(corners), outline=_colour(number), width=self._thickness(0.1))
        beside = 0.36 * (at - (len(same) - 1) / 2)
        self._write(draw, (column + 0.5 + beside, row + 0.5), number, _colour(number), "white")

    def _draw_train(self, draw: Any, number: int, train: Sight, place: tuple[int, int, int]) -> None:
        row, column, heading = place
        middle = np.array([column + 0.5, row + 0.5])
        size = 0.3 if train.is_waiting else 0.52
        if train.is_waiting:
            draw.ellipse(self._points(np.array([middle - 0.42, middle + 0.42])), GROUND, _colour(number))
        draw.polygon(self._points(arrowhead(middle, heading, size)), _colour(number), "white")
        if train.is_broken:
            for sign in (-1, 1):
                arm = np.array([0.4, 0.4 * sign])
                cross = np.array([middle - arm, middle + arm])
                draw.line(self._points(cross), "#C00000", self._thickness(0.12))
        self._write(draw, (column + 0.5, row + 0.5), number, "white", _colour(number))

    def _write(self, draw: Any, middle: tuple[float, float], number: int, colour: str, halo: str) -> None:
        """A number, unless cells are too small to read it."""
        size = 0.46 * self._cell
        if size >= 8 * FINER:
            where = (middle[0] * self._cell, middle[1] * self._cell)
            font = ImageFont.load_default(size)
            draw.text(where, str(number), colour, font, anchor="mm", stroke_width=FINER, stroke_fill=halo)

    def _points(self, line: Line) -> list[tuple[float, float]]:
        return [(x, y) for x, y in (line * self._cell).tolist()]

    def _thickness(self, share: float) -> int:
        return max(1, round(share * self._cell))


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]
