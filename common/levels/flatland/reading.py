"""Levels out of flatland-rl's own files: its pickles and its msgpack (`.pkl`, `.mpk`), of all versions since 2.0.

Speeds are taken as 4.3.0 takes them, so 0.33 is 1/3. Trains on their way are put back to their starts. A level without
a step limit gets the formula's for levels whose cities are not known.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.bounded import read_bounded
from railctl.common.levels.files import LARGEST_SIDE, LATEST, MOST_TRAINS, LevelFileError, problem_with
from railctl.common.levels.flatland.effects import malfunctions
from railctl.common.levels.flatland.inert import MOST_BYTES, NotPlainError, sequence, table, unpacked, unpickled, whole
from railctl.common.levels.flatland.trains import Train, static_train, train_of
from railctl.common.levels.level import Level, Malfunctions, Schedule
from railctl.common.levels.plain import is_plain, usable_headings

MOST_CELLS = 1_000_000
NO_CITIES = 2  # as many are assumed
PICKLES = range(2, 6)  # protocols


@dataclass(frozen=True)
class ReadLevel:
    """A level out of a file.

    Attributes:
        level: the level.
        left_out: what the file says and a level cannot, or lacks and was filled in, a line each.
    """

    level: Level
    left_out: list[str]


def read_level(path: Path) -> ReadLevel:
    """The level of a file that flatland-rl saved.

    Raises:
        LevelFileError: it cannot be read, or holds what a level cannot.
    """
    try:
        data = read_bounded(path, MOST_BYTES)
    except FileNotFoundError:
        raise LevelFileError(f"{path}: no such file") from None
    except OSError as error:
        raise LevelFileError(f"{path}: {error.strerror}") from None
    try:
        content = unpickled(data) if data[:1] == b"\x80" and data[1] in PICKLES else unpacked(data)
    except Exception:  # noqa: BLE001  (broken files raise anything)
        raise LevelFileError(f"{path} is neither a pickle nor msgpack of flatland-rl: save it again") from None
    try:
        return _level(content)
    except LevelFileError as error:
        raise LevelFileError(f"{path}: {error}") from None
    except (NotPlainError, KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
        raise LevelFileError(f"{path} is not as any version of flatland-rl saves an environment") from None


def _level(content: dict[str, Any]) -> ReadLevel:
    if content.get("level_free_positions"):
        free = content["level_free_positions"]
        if sequence(free, MOST_CELLS):
            raise LevelFileError("has level-free crossings, which are not supported")
    grid = _grid(content["grid"])
    static = content.get("agents_static")
    if static:
        trains = [static_train(train) for train in sequence(static, MOST_TRAINS)]
    else:
        trains = [train_of(train) for train in sequence(content["agents"], MOST_TRAINS)]
    limit = content.get("max_episode_steps")
    given = 0 if limit is None else whole(limit, 0, LATEST)
    steps = given or int(8 * (sum(grid.shape) + len(trains) / NO_CITIES))
    level = Level(
        grid=grid,
        starts=np.array([train.start for train in trains], np.int32).reshape(-1, 3),
        targets=np.array([train.target for train in trains], np.int32).reshape(-1, 2),
        max_steps=steps,
    )
    problem = problem_with(level)
    if problem is not None:
        raise LevelFileError(problem)
    breakdowns, notes = malfunctions(content)
    scheduled = replace(level, schedule=_schedule(level, trains, breakdowns))
    problem = problem_with(scheduled)
    if problem is not None:
        raise LevelFileError(problem)
    if not given:
        notes.append(f"without a step limit: {steps} steps are taken, 8 x (rows + columns + trains / {NO_CITIES})")
    return ReadLevel(level if is_plain(scheduled) else scheduled, [*notes, *_left_out(content, trains)])


def _grid(rows: Any) -> NDArray[np.uint16]:
    array = table(rows, MOST_CELLS)
    if array is None:
        lines = [sequence(row, LARGEST_SIDE) for row in sequence(rows, LARGEST_SIDE)]
        if len({len(line) for line in lines}) != 1:
            raise NotPlainError("a grid that is none")
        if len(lines) * len(lines[0]) > MOST_CELLS:
            raise LevelFileError(f"has a grid of {len(lines)}x{len(lines[0])}: {MOST_CELLS} cells are the most")
        array = np.array([[value if type(value) is int else whole(value) for value in line] for line in lines])
    if array.dtype.kind not in "iu" or array.size == 0 or array.min() < 0 or array.max() >= 1 << 16:
        raise NotPlainError("a grid that is none")
    return array.astype(np.uint16)


def _schedule(level: Level, trains: list[Train], breakdowns: Malfunctions | None) -> Schedule:
    usable = usable_headings(level)
    given = np.array([train.headings for train in trains], np.int32)
    headings = np.where(given == 0, usable, given & usable).astype(np.int32)
    if not headings.all():
        train = int(np.argmin(headings != 0))
        raise LevelFileError(f"train {train} can have none of the headings that count at its target")
    arrivals = [level.max_steps if train.arrival is None else train.arrival for train in trains]
    return Schedule(
        speeds=np.array([train.speed.as_integer_ratio() for train in trains], np.int32),
        earliest_departures=np.array([train.departure for train in trains], np.int32),
        latest_arrivals=np.array(arrivals, np.int32),
        target_headings=headings,
        malfunctions=breakdowns,
    )


def _left_out(content: dict[str, Any], trains: list[Train]) -> Iterator[str]:
    elapsed = content.get("elapsed_steps")
    under_way = sum(train.is_on_its_way for train in trains)
    if under_way:
        yield f"left out: the state of an episode under way: {_trains(under_way)} had departed"
    elif elapsed is not None and whole(elapsed) > 0:
        yield f"left out: the state of an episode under way: {whole(elapsed)} steps were played"
    stops = sum(train.has_stops for train in trains)
    if stops:
        yield f"left out: intermediate stops of {_trains(stops)}"
    rates = sum(train.breaks_down for train in trains)
    if rates:
        yield f"left out: malfunction rates of their own of {_trains(rates)}, as 2.0 had them"
    broken = sum(train.is_broken for train in trains)
    if broken:
        yield f"left out: malfunctions under way of {_trains(broken)}"
    if content.get("actions"):
        yield "left out: the recorded actions"


def _trains(count: int) -> str:
    return f"{count} train{'' if count == 1 else 's'}"
