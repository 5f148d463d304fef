"""Levels out of flatland-rl's own files: its pickles and its msgpack (`.pkl`, `.mpk`), of all versions since 2.0.

What the versions keep of a train, by position:
- `agents_static` (2.0 and the editor): start, heading, target, moving, speed data, malfunction data; the last may lack.
- 2.1 and 2.2: start, heading, heading now, target, moving, speed data, malfunction data, handle, status, position, ...
- 3 and 4: start, heading, heading now, target(s), moving, earliest departure, latest arrival, ..., and somewhere a
  `SpeedCounter`, or speed data in early ones.

Speeds are taken as 4.3.0 takes them, so 0.33 is 1/3. Trains on their way are put back to their starts. A level without
a step limit gets 4.3.0's formula for levels whose cities are not known.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from common.levels.files import LARGEST_SIDE, MOST_STEPS, LevelFileError, problem_with
from common.levels.flatland.inert import NotPlainError, Stub, number, sequence, unpacked, unpickled, whole
from common.levels.level import Level, Malfunctions, Schedule
from common.levels.plain import is_plain, usable_headings
from common.levels.speeds import speed_fraction

MOST_BYTES = 256_000_000
MOST_TRAINS = 10_000
NO_CITIES = 2  # as many are assumed
PICKLES = range(2, 6)  # protocols
NEVER = 1 << 31  # 3 and 4 write the largest number for trains without a latest arrival
MALFUNCTIONS = "MalfunctionEffectsGenerator"
HARMLESS_EFFECTS = {"EffectsGenerator", "RecordStepsEffectsGenerator", MALFUNCTIONS}


@dataclass(frozen=True)
class ReadLevel:
    """A level out of a file.

    Attributes:
        level: the level.
        left_out: what the file says and a level cannot, in words.
    """

    level: Level
    left_out: list[str]


@dataclass(frozen=True)
class _Train:
    start: tuple[int, int, int]
    target: tuple[int, int]
    headings: int  # a bit each; 0: all
    speed: Fraction
    departure: int
    arrival: int | None  # None: any time
    is_on_its_way: bool
    breaks_down: bool  # on its own, as in 2.0
    has_stops: bool


def read_level(path: Path) -> ReadLevel:
    """The level of a file that flatland-rl saved.

    Raises:
        LevelFileError: it cannot be read, or holds what a level cannot.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise LevelFileError(f"{path} is larger than any level: {MOST_BYTES // 1_000_000} MB are the most")
        data = path.read_bytes()
    except FileNotFoundError:
        raise LevelFileError(f"{path}: no such file") from None
    try:
        content = unpickled(data) if data[:1] == b"\x80" and data[1] in PICKLES else unpacked(data)
    except Exception:  # noqa: BLE001  (broken files raise anything)
        raise LevelFileError(f"{path} is neither a pickle nor msgpack of flatland-rl: save it again") from None
    try:
        found = _level(content)
    except LevelFileError as error:
        raise LevelFileError(f"{path}: {error}") from None
    except (NotPlainError, KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
        raise LevelFileError(f"{path} is not as any version of flatland-rl saves an environment") from None
    problem = problem_with(found.level)
    if problem is not None:
        raise LevelFileError(f"{path}: {problem}")
    return found


def _level(content: dict[str, Any]) -> ReadLevel:
    if content.get("level_free_positions") and sequence(content["level_free_positions"], LARGEST_SIDE):
        raise LevelFileError("has level-free crossings, which are not supported")
    grid = _grid(content["grid"])
    static = content.get("agents_static")
    if static:
        trains = [_static_train(train) for train in sequence(static, MOST_TRAINS)]
    else:
        trains = [_train(train) for train in sequence(content["agents"], MOST_TRAINS)]
    limit = content.get("max_episode_steps")
    steps = 0 if limit is None else whole(limit, 0, MOST_STEPS)
    if steps == 0:
        steps = int(8 * (sum(grid.shape) + len(trains) / NO_CITIES))
    level = Level(
        grid=grid,
        starts=np.array([train.start for train in trains], np.int32).reshape(-1, 3),
        targets=np.array([train.target for train in trains], np.int32).reshape(-1, 2),
        max_steps=steps,
    )
    problem = problem_with(level)
    if problem is not None:
        raise LevelFileError(problem)
    malfunctions, notes = _malfunctions(content)
    scheduled = replace(level, schedule=_schedule(level, trains, malfunctions))
    left_out = [*notes, *_left_out(content, trains)]
    return ReadLevel(level if is_plain(scheduled) else scheduled, left_out)


def _grid(rows: Any) -> np.ndarray[Any, np.dtype[np.uint16]]:
    lines = [sequence(row, LARGEST_SIDE) for row in sequence(rows, LARGEST_SIDE)]
    if len({len(line) for line in lines}) != 1:
        raise NotPlainError("a grid that is none")
    return np.array([[whole(cell, 0, 2**16 - 1) for cell in line] for line in lines], np.uint16)


def _cell(value: Any) -> tuple[int, int]:
    row, column = sequence(value, 2)
    return whole(row, most=LARGEST_SIDE), whole(column, most=LARGEST_SIDE)


def _static_train(train: Any) -> _Train:
    """Of `agents_static`."""
    fields = sequence(train, 100)
    data = fields[4] if len(fields) > 4 else None
    breakdowns = fields[5] if len(fields) > 5 else None
    return _Train(
        start=(*_cell(fields[0]), whole(fields[1])),
        target=_cell(fields[2]),
        headings=0,
        speed=_speed(data),
        departure=0,
        arrival=None,
        is_on_its_way=False,
        breaks_down=_breaks_down(breakdowns),
        has_stops=False,
    )


def _train(train: Any) -> _Train:
    """Of `agents`, which are tuples with names."""
    fields = list(train.arguments) if isinstance(train, Stub) else sequence(train, 100)
    target, headings = _target(fields[3])
    old = isinstance(fields[5], dict)  # 2.1 and 2.2
    departure, arrival = (None, None) if old else (fields[5], fields[6])
    position = fields[9 if old else _after_handle(fields)]
    latest = NEVER if arrival is None else whole(arrival)
    dictionaries = [field for field in fields if isinstance(field, dict)]
    return _Train(
        start=(*_cell(fields[0]), whole(fields[1])),
        target=target,
        headings=headings,
        speed=_speed(next((field for field in fields[5:] if _has_speed(field)), None)),
        departure=0 if departure is None else whole(departure, 0, MOST_STEPS),
        arrival=None if latest >= NEVER else whole(latest, 0),
        is_on_its_way=position is not None,
        breaks_down=any(_breaks_down(field) for field in dictionaries),
        has_stops=any(isinstance(field, list | tuple) and len(field) > 2 for field in fields[16:17]),
    )


def _after_handle(fields: list[Any]) -> int:
    """Where 3 and 4 keep a train's position: after the windows, data in dictionaries and the handle, and a status."""
    at = next(at for at in range(7, len(fields)) if not isinstance(fields[at], dict)) + 1
    status = fields[at]
    return at + 1 if isinstance(status, Stub) and status.is_called == "RailAgentStatus" else at


def _has_speed(field: Any) -> bool:
    if isinstance(field, Stub):
        return field.is_called == "SpeedCounter"
    return isinstance(field, dict) and "speed" in field


def _speed(data: Any) -> Fraction:
    """Out of speed data or a `SpeedCounter`; 1 if there is none."""
    if data is None:
        return Fraction(1)
    state = data.state if isinstance(data, Stub) else data
    if not isinstance(state, dict):
        raise NotPlainError("a speed that is none")
    for name in ("max_speed", "_max_speed", "_speed", "speed"):
        if state.get(name) is not None:
            try:
                return speed_fraction(number(state[name]))
            except NotPlainError:
                raise
            except ValueError as error:
                raise LevelFileError(f"has {error}") from None
    raise NotPlainError("a speed that is none")


def _breaks_down(data: Any) -> bool:
    return isinstance(data, dict) and "malfunction_rate" in data and number(data["malfunction_rate"]) > 0


def _target(targets: Any) -> tuple[tuple[int, int], int]:
    """The cell of a target and its headings: a cell alone before 4.3, since then all cells and headings that count."""
    found = sequence(targets, 4 * LARGEST_SIDE)
    if not any(isinstance(part, tuple | list) for part in found):
        return _cell(targets), 0
    ends = []
    for end in found:
        cell, heading = sequence(end, 2)
        ends.append((_cell(cell), whole(heading, 0, 3)))
    if len({cell for cell, _ in ends}) != 1:
        raise LevelFileError("a train has targets in several cells, which is not supported")
    return ends[0][0], sum({1 << heading for _, heading in ends})


def _schedule(level: Level, trains: list[_Train], malfunctions: Malfunctions | None) -> Schedule:
    usable = usable_headings(level)
    given = np.array([train.headings for train in trains], np.int32)
    arrivals = [level.max_steps if train.arrival is None else train.arrival for train in trains]
    return Schedule(
        speeds=np.array([train.speed.as_integer_ratio() for train in trains], np.int32),
        earliest_departures=np.array([train.departure for train in trains], np.int32),
        latest_arrivals=np.array(arrivals, np.int32),
        target_headings=np.where(given == 0, usable, given & usable).astype(np.int32),
        malfunctions=malfunctions,
    )


def _malfunctions(content: dict[str, Any]) -> tuple[Malfunctions | None, list[str]]:
    """What breaks trains down, and what else happens that a level cannot say.

    The effects of 4.2 and later say all, if they are there; before them the parameters stood alone.
    """
    effects = content.get("effects_generator")
    if effects is None:
        parameters = content.get("malfunction")
        values = parameters.arguments if isinstance(parameters, Stub) else parameters
        return (None if values is None else _parameters(sequence(values, 3))), []
    found, others = None, []
    for name, options in _effects(effects):
        given = options.get("param_malfunction_gen")
        if name == MALFUNCTIONS and isinstance(given, dict):
            found = _parameters([given[key] for key in ("malfunction_rate", "min_duration", "max_duration")])
        elif name not in HARMLESS_EFFECTS:
            others.append(f"effects of {name[:60]}")
    return found, others


def _effects(effects: Any, depth: int = 4) -> Iterator[tuple[str, dict[str, Any]]]:
    """Class names and options of all effects of a file."""
    if not isinstance(effects, dict) or depth == 0:
        raise NotPlainError("effects that are none")
    specs = effects.get("specs") or {}
    inner = sequence(specs.get("args", []), 100)
    if not inner:
        yield str(effects["cls"]).rpartition(".")[2], specs.get("kwargs") or {}
    for effect in inner:
        yield from _effects(effect, depth - 1)


def _parameters(values: list[Any]) -> Malfunctions | None:
    """Rate, least and most steps. Before 2.2 the rate was the steps from one malfunction to the next."""
    rate = float(number(values[0]))
    if not rate > 0:
        return None
    shortest, longest = (whole(value, 0, MOST_STEPS) for value in values[1:])
    return Malfunctions(1 / rate if rate > 1 else rate, shortest, max(shortest, longest))


def _left_out(content: dict[str, Any], trains: list[_Train]) -> Iterator[str]:
    elapsed = content.get("elapsed_steps")
    if any(train.is_on_its_way for train in trains) or (elapsed is not None and whole(elapsed) > 0):
        yield "the state of an episode under way: all trains are back at their starts"
    stops = sum(train.has_stops for train in trains)
    if stops:
        yield f"intermediate stops of {stops} trains"
    if any(train.breaks_down for train in trains):
        yield "malfunction rates of single trains"
    if content.get("actions"):
        yield "the recorded actions"
