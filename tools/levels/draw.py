"""A level as a picture: its map with all trains where they start, their shortest ways and targets, and a list of them.

How trains and targets look: `common.pictures.glyphs`. The list is beside the map and no higher, so that of many trains
it is cut; the map has all their numbers.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from PIL import Image, ImageDraw

from railctl.common.levels.level import Level
from railctl.common.pictures.canvas import Canvas, Window, cell_size, with_rim
from railctl.common.pictures.glyphs import Sight, colour_of
from railctl.common.pictures.legend import beside, drawn_text, legend, stacked
from railctl.common.pictures.pen import INK, PAPER, font
from railctl.common.rail.tracks import Line, track
from railctl.tools.levels.routes import Place, shortest_route

HEADINGS = "NESW"
MOST_PIXELS, LARGEST_CELL = 2400, 36  # of the map's longer side, of a cell's side
LEAST_WIDTH, GAP = 420, 16  # pixels: of what is under the title, around the list
TITLE, TEXT, LINE = 17, 13, 18  # pixels: of signs, of a line of the list
LEAST_LINES, MOST_COLUMNS = 12, 3  # of the list
SHAPES: Final = ("waits to depart", "target of train 1", "1+2: train 1 and 2 more")


def draw(level: Level, path: Path, title: str) -> Path:
    """Draw a level into a .png file; returns its path."""
    height, width = level.grid.shape
    routes = [shortest_route(level, train) for train in range(level.n_trains)]
    canvas = Canvas(level, cell_size(max(height, width), MOST_PIXELS, LARGEST_CELL))
    starts: list[Place] = [(row, column, heading) for row, column, heading in level.starts.tolist()]
    trains = [Sight(start, is_waiting=True, is_broken=False) for start in starts]
    paths = [(train, _beside_others(level, train, route)) for train, route in enumerate(routes) if route]
    drawn = with_rim(canvas.image(trains, paths), canvas.cell, Window(0, 0, height, width))
    lines = [_line(level, train, route) for train, route in enumerate(routes)]
    body = beside([drawn, _listed(lines, drawn.height)], GAP)
    whole = max(LEAST_WIDTH, body.width)
    counts = f"{level.n_trains} train{'s' * (level.n_trains != 1)}, {height}x{width} cells, {level.max_steps} steps"
    head = [drawn_text(title, whole, TITLE, strong=True), drawn_text(counts, whole, TEXT)]
    stacked([*head, body, legend(SHAPES, whole)]).save(path, "PNG", optimize=True)
    return path


def _beside_others(level: Level, train: int, route: Sequence[Place]) -> Line:
    """[P, 2]: the rails of a route, shifted so that routes can be told apart that share them."""
    return track(route) + 0.44 * ((train + 0.5) / level.n_trains - 0.5)


def _line(level: Level, train: int, route: Sequence[Place] | None) -> str:
    row, column, heading = level.starts[train].tolist()
    target_row, target_column = level.targets[train].tolist()
    cells = "no way" if route is None else f"{len(route) - 1} cell{'s' * (len(route) != 2)}"
    return f"{train}: ({row}, {column}) {HEADINGS[heading]} to ({target_row}, {target_column}), {cells}"


def _listed(lines: Sequence[str], height: int) -> Any:
    """The trains in columns of a map's height, or of a few lines; the last line says what there is no room for."""
    fit = max(LEAST_LINES, height // LINE - 1)
    if len(lines) > fit * MOST_COLUMNS:
        kept = fit * MOST_COLUMNS - 1
        lines = [*lines[:kept], f"and {len(lines) - kept} more"]
    columns = [lines[first : first + fit] for first in range(0, len(lines), fit)]
    return beside([_column(at * fit, column) for at, column in enumerate(columns)], GAP)


def _column(first: int, lines: Sequence[str]) -> Any:
    """Lines of the list, from the train of a number on; each begins with the train's colour."""
    width = max(int(font(TEXT).getlength(line)) for line in lines)
    image = Image.new("RGB", (LINE + width + GAP, (len(lines) + 1) * LINE), PAPER)
    pen = ImageDraw.Draw(image)
    if first == 0:
        pen.text((0, LINE // 2), "train: start to target", INK, font(TEXT), anchor="lm")
    for at, line in enumerate(lines):
        middle = (at + 1.5) * LINE
        if not line.startswith("and "):
            pen.rectangle([(0, middle - 5), (10, middle + 5)], colour_of(first + at))
        pen.text((LINE, middle), line, INK, font(TEXT), anchor="lm")
    return image
