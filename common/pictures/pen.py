"""Drawing in cells instead of pixels, and writing."""

from functools import cache
from typing import Any, Final

from PIL import ImageDraw, ImageFont

from railctl.common.rail.tracks import Line

FINER: Final = 2  # drawn so many times as large, then averaged: edges become smooth
INK, PAPER = "#1C1B1A", "#FFFFFF"
LEAST_SIGNS: Final = 8  # pixels: numbers that are smaller cannot be read


@cache
def font(size: float) -> Any:
    """The font that comes with Pillow, of a height in pixels."""
    return ImageFont.load_default(size)


class Pen:
    """Draws on an image where x and y are in cells.

    Args:
        image: what is drawn on, of `FINER` times the size that it will have.
        cell: pixels of it a cell.
        origin: where the north-western corner is, in its pixels.
    """

    def __init__(self, image: Any, cell: float, origin: tuple[float, float] = (0.0, 0.0)) -> None:
        self._draw: Any = ImageDraw.Draw(image)
        self.cell, self._origin = cell, origin

    def points(self, line: Line) -> list[tuple[float, float]]:
        """In pixels."""
        left, top = self._origin
        return [(left + x * self.cell, top + y * self.cell) for x, y in line.tolist()]

    def thickness(self, share: float) -> int:
        """Of a line, as a share of a cell."""
        return max(1, round(share * self.cell))

    def line(self, line: Line, colour: str, share: float) -> None:
        """A line [P, 2] as thick as this share of a cell."""
        self._draw.line(self.points(line), colour, self.thickness(share), joint="curve")

    def polygon(self, corners: Line, colour: str, edge: str) -> None:
        """A filled shape [P, 2]."""
        self._draw.polygon(self.points(corners), colour, edge, width=self.thickness(0.04))

    def ellipse(self, corners: Line, colour: str, edge: str, share: float = 0.04) -> None:
        """Within two corners [2, 2]."""
        self._draw.ellipse(self.points(corners), colour, edge, self.thickness(share))

    def rectangle(self, corners: Line, colour: str | None, edge: str | None = None, share: float = 0.04) -> None:
        """Between two corners [2, 2]."""
        self._draw.rectangle(self.points(corners), colour, edge, self.thickness(share))

    def write(self, middle: tuple[float, float], text: str, colour: str, halo: str, room: float = 1.0) -> None:
        """A number around a place, in `room` cells; nothing where cells are too small to read it."""
        size = 0.5 * self.cell
        size *= min(1.0, room * self.cell / font(size).getlength(text))
        if size < LEAST_SIGNS * FINER:
            return
        where = (self._origin[0] + middle[0] * self.cell, self._origin[1] + middle[1] * self.cell)
        bold = 0.035 * size
        for shade, stroke in ((halo, bold + 0.055 * self.cell), (colour, bold)):
            self._draw.text(where, text, shade, font(size), anchor="mm", stroke_width=stroke, stroke_fill=shade)
