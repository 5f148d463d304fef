"""A line that says which shape means what: of the shapes that there are."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from PIL import Image, ImageDraw

from railctl.common.pictures.glyphs import Sight, draw_hatching, draw_target, draw_train, draw_waiting
from railctl.common.pictures.pen import FINER, INK, PAPER, Pen, font

CELL, GAP, LINE = 28, 6, 34  # pixels: of a shape, beside it, of a line
TEXT = 13
_EAST: Final = Sight((0, 0, 1), is_waiting=False, is_broken=False)


def _jammed(pen: Pen) -> None:
    draw_hatching(pen, 0, 0)
    draw_train(pen, 1, _EAST._replace(stands=True))


SHAPES: dict[str, Callable[[Pen], None]] = {
    "moving": lambda pen: draw_train(pen, 1, _EAST),
    "stands": lambda pen: draw_train(pen, 1, _EAST._replace(stands=True)),
    "waits to depart": lambda pen: draw_waiting(pen, (0, 0), [(1, _EAST)]),
    "jammed for good": _jammed,
    "broken down": lambda pen: draw_train(pen, 1, _EAST._replace(is_broken=True)),
    "late": lambda pen: draw_train(pen, 1, _EAST._replace(is_late=True)),
    "target of train 1": lambda pen: draw_target(pen, (0, 0), [1]),
    "1+2: train 1 and 2 more": lambda pen: draw_target(pen, (0, 0), [1, 2, 3]),
}


def legend(shapes: Sequence[str], width: int) -> Any:
    """A picture of this width, with as many lines as it takes."""
    places, x, y = [], GAP, 0
    for name in shapes:
        need = CELL + GAP + int(font(TEXT).getlength(name)) + 3 * GAP
        if x > GAP and x + need > width:
            x, y = GAP, y + LINE
        places.append((name, x, y))
        x += need
    image = Image.new("RGB", (width, y + LINE), PAPER)
    draw = ImageDraw.Draw(image)
    for name, left, top in places:
        image.paste(_shape(SHAPES[name]), (left, top + (LINE - CELL) // 2))
        draw.text((left + CELL + GAP, top + LINE // 2), name, INK, font(TEXT), anchor="lm")
    return image


def _shape(draw: Callable[[Pen], None]) -> Any:
    """Drawn with some room around it, as shapes reach beyond their cells."""
    image = Image.new("RGB", (CELL * FINER, CELL * FINER), PAPER)
    margin = 0.1 * CELL * FINER
    draw(Pen(image, 0.8 * CELL * FINER, (margin, margin)))
    return image.reduce(FINER)


def drawn_text(text: str, width: int, size: float, *, strong: bool = False) -> Any:
    """A line of text; what there is no room for ends in dots."""
    kind = font(size)
    if kind.getlength(text) > width - 2 * GAP:
        while text and kind.getlength(text + "...") > width - 2 * GAP:
            text = text[:-1]
        text += "..."
    image = Image.new("RGB", (width, round(1.5 * size)), PAPER)
    where = (GAP, image.height // 2)
    ImageDraw.Draw(image).text(where, text, INK, kind, anchor="lm", stroke_width=0.4 if strong else 0, stroke_fill=INK)
    return image


def stacked(images: Sequence[Any]) -> Any:
    """One below the other, as wide as the widest."""
    image = Image.new("RGB", (max(each.width for each in images), sum(each.height for each in images)), PAPER)
    for each, top in zip(images, np.cumsum([0, *(each.height for each in images)]).tolist(), strict=False):
        image.paste(each, (0, top))
    return image


def beside(images: Sequence[Any], gap: int) -> Any:
    """One beside the other, as high as the highest."""
    width = sum(each.width for each in images) + gap * (len(images) - 1)
    image = Image.new("RGB", (width, max(each.height for each in images)), PAPER)
    left = 0
    for each in images:
        image.paste(each, (left, 0))
        left += each.width + gap
    return image
