"""A moment of one episode, or of several beside each other on the same level."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level
from railctl.common.pictures.canvas import RIM, Canvas, cell_size, used_window, with_rim
from railctl.common.pictures.glyphs import Sight
from railctl.common.pictures.legend import beside, drawn_text, legend, stacked
from railctl.common.playback import ARRIVED, BROKEN, JAMMED, LATE, STOPPED, WAITING, Playback
from railctl.common.rail.tracks import Line, track
from railctl.common.records.course import NONE, normalised_return

LEAST_WIDTH, GAP, LARGEST_CELL = 380, 16, 36  # pixels: of a map's header, between two, of a cell's side
TITLE, TEXT = 17, 14
SHOWN_STILL = 4  # moments of a stretch in which nothing happens
MALFUNCTION, FLAGS = 4, 5  # columns of a moment


class Panel:
    """One episode: its map under a title and figures."""

    def __init__(self, title: str, played: Playback, cell: int) -> None:
        """With so many pixels a cell."""
        self.title, self.moments = title, np.array(played.steps, np.int32)
        self.ends = len(self.moments) - 1
        self._level = level_of(played)
        self._canvas, self._window = Canvas(self._level, cell), used_window(self._level)
        state = self.moments[..., 0]
        arrived = (state == ARRIVED).any(axis=0)
        self._arrived_at = np.where(arrived, (state == ARRIVED).argmax(axis=0) - 1, NONE)

    def picture(self, moment: int, *, with_paths: bool = False) -> Any:
        """At a moment, or at its last if it has fewer."""
        at = min(moment, self.ends)
        rows = self.moments[at]
        paths = [(train, self._path(train, at)) for train in range(len(rows))] if with_paths else []
        drawn = with_rim(self._canvas.image(sights(rows), paths), self._canvas.cell, self._window)
        width = max(LEAST_WIDTH, drawn.width)
        title = drawn_text(self.title, width, TITLE, strong=True)
        return stacked([title, drawn_text(self._figures(at), width, TEXT), drawn])

    def _figures(self, at: int) -> str:
        rows = self.moments[at]
        arrived_at = np.where(self._arrived_at < at, self._arrived_at, NONE)
        parts = [f"step {at}", f"arrived {int((arrived_at != NONE).sum())} of {len(rows)}"]
        jammed, late = (int((rows[:, FLAGS] & flag > 0).sum()) for flag in (JAMMED, LATE))
        broken = int(((rows[:, MALFUNCTION] > 0) & (rows[:, 0] != ARRIVED)).sum())
        parts += [
            f"{word} {count}" for word, count in (("jammed", jammed), ("broken", broken), ("late", late)) if count
        ]
        so_far = normalised_return(arrived_at.astype(np.int32), at, self._level.max_steps)
        parts.append(f"return {so_far:.3f}")
        return "   ".join(parts) + ("   the end" if at == self.ends else "")

    def _path(self, train: int, at: int) -> Line:
        """[P, 2]: where a train has been, from the middle of its first cell; a point if it never departed."""
        shift = 0.36 * ((train + 0.5) / self._level.n_trains - 0.5)  # beside each other where they share rails
        rows = self.moments[: at + 1, train]
        places = rows[rows[:, 0] != WAITING][:, 1:4]
        changed = np.ones(len(places), np.bool_)
        changed[1:] = (places[1:] != places[:-1]).any(axis=1)
        return track([(*place,) for place in places[changed].tolist()]) + shift


def sights(rows: NDArray[np.int32]) -> list[Sight]:
    """What is drawn of a moment [N, 6]."""
    return [
        Sight(
            None if state == ARRIVED else (row, column, heading),
            is_waiting=state == WAITING,
            is_broken=state == BROKEN or malfunction > 0,
            stands=state == STOPPED,
            is_jammed=bool(flags & JAMMED),
            is_late=bool(flags & LATE),
        )
        for state, row, column, heading, malfunction, flags in rows.tolist()
    ]


def level_of(played: Playback) -> Level:
    """As far as pictures need it."""
    level = played.level
    starts = np.array([train.start for train in level.trains], np.int32)
    targets = np.array([train.target for train in level.trains], np.int32)
    return Level(np.array(level.grid, np.uint16), starts, targets, level.max_steps)


class Scene:
    """Episodes on the same level beside each other, under the level's name and above what shapes mean."""

    def __init__(self, episodes: Sequence[tuple[str, Playback]], most_pixels: int) -> None:
        """Titles and episodes, and how wide their maps may be altogether."""
        level = episodes[0][1].level
        top, left, bottom, right = used_window(level_of(episodes[0][1]))
        cells, rims = max((right - left) * len(episodes), bottom - top), (RIM + GAP) * len(episodes)
        cell = cell_size(cells, most_pixels - rims, LARGEST_CELL)
        self.panels = [Panel(title, played, cell) for title, played in episodes]
        self.ends = max(panel.ends for panel in self.panels)
        where = f"level {level.number} of {level.file}, {level.name}" if level.file else f"{level.name} {level.number}"
        trains = f"{len(level.trains)} train{'s' * (len(level.trains) != 1)}"
        self._title = f"{where}: {trains}, {level.height}x{level.width} cells, {level.max_steps} steps at most"
        self._shapes = shapes_of(self.panels, level_of(episodes[0][1]))
        self._frame: tuple[Any, Any] | None = None

    def picture(self, moment: int, *, with_paths: bool = False) -> Any:
        """All of it at a moment."""
        maps = beside([panel.picture(moment, with_paths=with_paths) for panel in self.panels], GAP)
        if self._frame is None:
            self._frame = drawn_text(self._title, maps.width, TEXT), legend(self._shapes, maps.width)
        head, foot = self._frame
        return stacked([head, maps, foot])

    def shown(self) -> list[int]:
        """Moments worth a picture: of stretches in which nothing happens the first ones, and the end."""
        length = self.ends + 1
        held = [panel.moments[np.minimum(np.arange(length), panel.ends)] for panel in self.panels]
        changed = np.ones(length, np.bool_)
        seen = np.concatenate([np.delete(moments, MALFUNCTION, axis=2) for moments in held], axis=1)
        changed[1:] = (seen[1:] != seen[:-1]).any(axis=(1, 2))
        since = np.arange(length) - np.maximum.accumulate(np.where(changed, np.arange(length), 0))
        ends = np.append(changed[1:], True)
        moments: list[int] = np.flatnonzero((since < SHOWN_STILL) | ends).tolist()
        return moments


def shapes_of(panels: Sequence[Panel], level: Level) -> list[str]:
    """What there is to explain."""
    rows = np.concatenate([panel.moments.reshape(-1, panel.moments.shape[2]) for panel in panels])
    there = {
        "moving": True,
        "stands": bool((rows[:, 0] == STOPPED).any()),
        "waits to depart": True,
        "jammed for good": bool((rows[:, FLAGS] & JAMMED).any()),
        "broken down": bool((rows[:, MALFUNCTION] > 0).any()),
        "late": bool((rows[:, FLAGS] & LATE).any()),
        "target of train 1": True,
        "1+2: train 1 and 2 more": any(
            len({tuple(cell) for cell in cells.tolist()}) < len(cells) for cells in (level.targets, level.starts[:, :2])
        ),
    }
    return [name for name, is_there in there.items() if is_there]
