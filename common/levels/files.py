"""Files of levels that are passed around: one .npz with groups of levels, as `easy` or `rounds_1`.

Of every group three arrays: `<group>_levels_grid` [K, H, W], `<group>_levels_agents` [K, N, 5] (row, column and heading
at the start, row and column of the target) and `<group>_levels_max_steps` [K]. So all levels of a group are of one
shape. Files are checked before they are believed; nothing in them is unpickled.

If any level of a group has a schedule, six more: `<group>_levels_scheduled` [K] (0: this one has none),
`<group>_levels_speeds` [K, N, 2] (numerator, denominator), `<group>_levels_departures`, `<group>_levels_arrivals` and
`<group>_levels_target_headings` [K, N], and `<group>_levels_malfunctions` [K, 3] (rate, 0 for none, and least and
most steps). Names and meanings are those of `common.levels.level.Schedule`.
"""

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from math import lcm
from pathlib import Path
from typing import Any
from zipfile import ZipInfo

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from railctl.common.bounded import open_at_once
from railctl.common.levels.level import MOST_STEPS, Level, Malfunctions, Schedule
from railctl.common.levels.speeds import LARGEST_UNIT
from railctl.common.whole import write_whole

GRID, AGENTS, MAX_STEPS = "_levels_grid", "_levels_agents", "_levels_max_steps"
SCHEDULED, MALFUNCTIONS = "_levels_scheduled", "_levels_malfunctions"
COLUMNS = {  # of a schedule
    "speeds": "_levels_speeds",
    "earliest_departures": "_levels_departures",
    "latest_arrivals": "_levels_arrivals",
    "target_headings": "_levels_target_headings",
}
LARGEST_SIDE = 4096
LATEST = 100_000_000  # step that a timetable or a malfunction may name
MOST_TRAIN_STEPS = 100_000_000  # of all trains of a level together: what is noted of them has to fit in memory
MOST_TRAINS = 10_000
MOST_LEVELS = 500_000  # of a group
MOST_ARRAY_BYTES = 1 << 30  # unpacked: a small file may announce any size
MOST_FILE_BYTES = 1 << 32  # packed, and of all its arrays unpacked
ARCHIVE, LONE_ARRAY = b"PK", b"\x93NUMPY"  # begin an archive of numpy's, and a file with one array

Groups = dict[str, list[Level]]


class LevelFileError(ValueError):
    """A file that does not hold what it should: one line that names it and what is wrong."""


class StoredArrays(Mapping[str, NDArray[Any]]):
    """The arrays of an .npz file, each read when it is asked for."""

    def __init__(self, path: Path, file: NpzFile) -> None:
        self._path = path
        self._file = file
        self._names = dict.fromkeys(file.files)

    def __contains__(self, name: object) -> bool:  # that of Mapping would read the array
        return name in self._names

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self:
            raise KeyError(name)
        if sum(entry.file_size for entry in self._entries(name)) > MOST_ARRAY_BYTES:
            raise LevelFileError(f"{self._path}: the array {name} has over {MOST_ARRAY_BYTES} bytes: split the file")
        try:
            array = self._file[name]
        except Exception as error:  # noqa: BLE001  (numpy passes on whatever its parsers raise)
            if "allow_pickle" in str(error):
                problem = "holds Python objects, which are not read: save it as an array of numbers"
            else:
                problem = "is damaged: save the file again"
            raise LevelFileError(f"{self._path}: the array {name} {problem}") from None
        if not isinstance(array, np.ndarray):
            raise LevelFileError(f"{self._path}: {name} is no array: save it with numpy")
        return array

    def _entries(self, name: str) -> Iterator[ZipInfo]:
        if self._file.zip is not None:
            yield from (entry for entry in self._file.zip.infolist() if entry.filename in {name, f"{name}.npy"})

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@contextmanager
def opened(path: Path) -> Iterator[StoredArrays]:
    """The arrays of an .npz file, as long as it is open.

    Raises:
        LevelFileError: it is none.
    """
    with ExitStack() as stack:
        file = _archive(path, stack)
        if not all(name.isprintable() for name in file.files):
            raise LevelFileError(f"{path} has arrays whose names cannot be printed: save it again")
        yield StoredArrays(path, stack.enter_context(file))


def _archive(path: Path, stack: ExitStack) -> NpzFile:
    """The file as numpy opens it; what is no archive, or too large for one, is not read."""
    try:
        content = stack.enter_context(open_at_once(path))
        begin, size = content.read(len(LONE_ARRAY)), content.seek(0, os.SEEK_END)
        content.seek(0)
    except FileNotFoundError:
        raise LevelFileError(f"{path}: no such file") from None
    except OSError:
        size, begin = 0, b""
    if begin == LONE_ARRAY:
        raise LevelFileError(f"{path} is no readable .npz file of arrays: it holds a single array")
    if size > MOST_FILE_BYTES:
        raise LevelFileError(f"{path} has over {MOST_FILE_BYTES} bytes: split it")
    try:
        file = np.load(content, allow_pickle=False) if begin.startswith(ARCHIVE) else None
    except Exception:  # noqa: BLE001  (numpy passes on whatever its parsers raise)
        file = None
    if not isinstance(file, NpzFile):
        raise LevelFileError(f"{path} is no readable .npz file of arrays: save it again with numpy")
    if file.zip is not None and sum(entry.file_size for entry in file.zip.infolist()) > MOST_FILE_BYTES:
        raise LevelFileError(f"{path}: its arrays have over {MOST_FILE_BYTES} bytes: split it")
    return file


def save(path: Path, groups: Mapping[str, Sequence[Level]]) -> None:
    """Write groups of levels; a file that was there is replaced in one step.

    Raises:
        LevelFileError: the levels of a group differ in shape.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for name, levels in groups.items():
        shapes = {(level.grid.shape, level.n_trains) for level in levels}
        if len(shapes) != 1:
            raise LevelFileError(f"the levels of {name} differ in size or trains: save them as groups of their own")
        arrays[name + GRID] = np.stack([level.grid for level in levels])
        agents = [np.concatenate([level.starts, level.targets], axis=1) for level in levels]
        arrays[name + AGENTS] = np.stack(agents).astype(np.int16)
        arrays[name + MAX_STEPS] = np.array([level.max_steps for level in levels], np.int32)
        if any(level.schedule is not None for level in levels):
            arrays |= {name + key: array for key, array in _schedule_arrays(levels).items()}
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    write_whole(path, content.getvalue())


def _schedule_arrays(levels: Sequence[Level]) -> dict[str, NDArray[Any]]:
    trains = levels[0].n_trains
    nothing = np.zeros(trains, np.int32)
    none = Schedule(np.zeros((trains, 2), np.int32), nothing, nothing, nothing)
    schedules = [level.schedule or none for level in levels]
    arrays: dict[str, NDArray[Any]] = {
        key: np.stack([getattr(schedule, field) for schedule in schedules]).astype(np.int32)
        for field, key in COLUMNS.items()
    }
    arrays[SCHEDULED] = np.array([level.schedule is not None for level in levels], np.uint8)
    arrays[MALFUNCTIONS] = np.array([schedule.malfunctions or (0.0, 0, 0) for schedule in schedules], np.float64)
    return arrays


def load(path: Path) -> Groups:
    """Read all groups of a file.

    Raises:
        LevelFileError: the file cannot be read, or something in it is no level.
    """
    ours = GRID, AGENTS, MAX_STEPS, SCHEDULED, MALFUNCTIONS, *COLUMNS.values()
    with opened(path) as stored:
        arrays = {name: stored[name] for name in stored if name.endswith(ours)}
    names = [key.removesuffix(GRID) for key in arrays if key.endswith(GRID)]
    if not names:
        raise LevelFileError(f"{path} has no array named <group>{GRID}, so it holds no levels")
    return {name: _group(path, name, arrays) for name in names}


def _group(path: Path, name: str, arrays: Mapping[str, NDArray[Any]]) -> list[Level]:
    for key in (name + AGENTS, name + MAX_STEPS):
        if key not in arrays:
            raise LevelFileError(f"{path} lacks the array {key}")
    grids, agents, limits = arrays[name + GRID], arrays[name + AGENTS], arrays[name + MAX_STEPS]
    if not all(np.issubdtype(array.dtype, np.integer) for array in (grids, agents, limits)):
        raise LevelFileError(f"{path}: the arrays of {name} must hold integers")
    if grids.ndim != 3 or agents.shape != (len(grids), *agents.shape[1:2], 5) or limits.shape != grids.shape[:1]:
        raise LevelFileError(f"{path}: the arrays of {name} do not have shapes [K, H, W], [K, N, 5] and [K]")
    if len(grids) > MOST_LEVELS:
        raise LevelFileError(f"{path}: {name} has {len(grids)} levels, {MOST_LEVELS} are the most of a group: split it")
    for array, bits in ((grids, 16), (agents, 31), (limits, 31)):
        if array.size and (array.min() < 0 or int(array.max()) >= 1 << bits):
            raise LevelFileError(f"{path}: the arrays of {name} hold numbers below 0 or beyond {bits} bits")
    levels = []
    schedules = _schedules(path, name, arrays, len(grids), agents.shape[1])
    for index, (grid, trains, limit) in enumerate(zip(grids, agents, limits, strict=True)):
        level = Level(
            grid=grid.astype(np.uint16),
            starts=np.ascontiguousarray(trains[:, :3], np.int32),
            targets=np.ascontiguousarray(trains[:, 3:], np.int32),
            max_steps=int(limit),
            schedule=schedules[index],
        )
        problem = problem_with(level)
        if problem is not None:
            raise LevelFileError(f"{path}: level {index} of {name}: {problem}")
        levels.append(level)
    return levels


def _schedules(
    path: Path, name: str, arrays: Mapping[str, NDArray[Any]], levels: int, trains: int
) -> list[Schedule | None]:
    """The schedules of a group, whatever they hold."""
    if name + SCHEDULED not in arrays:
        return [None] * levels
    shapes: dict[str, tuple[int, ...]] = {
        key: (levels, trains, 2) if field == "speeds" else (levels, trains) for field, key in COLUMNS.items()
    }
    shapes |= {SCHEDULED: (levels,), MALFUNCTIONS: (levels, 3)}
    for key, shape in shapes.items():
        if name + key not in arrays:
            raise LevelFileError(f"{path} lacks the array {name}{key}")
        array = arrays[name + key]
        kind = np.floating if key == MALFUNCTIONS else np.integer
        if array.shape != shape or not np.issubdtype(array.dtype, kind):
            raise LevelFileError(f"{path}: the array {name}{key} is no array of {kind.__name__} of shape {list(shape)}")
        if not np.isfinite(array).all() or (abs(array.astype(np.float64)) >= 2**31).any():
            raise LevelFileError(f"{path}: the array {name}{key} holds numbers beyond 32 bits")
    found: list[Schedule | None] = []
    for index in range(levels):
        rate, shortest, longest = arrays[name + MALFUNCTIONS][index].tolist()
        schedule = Schedule(
            **{field: arrays[name + key][index].astype(np.int32) for field, key in COLUMNS.items()},
            malfunctions=Malfunctions(rate, int(shortest), int(longest)) if rate > 0 else None,
        )
        found.append(schedule if arrays[name + SCHEDULED][index] else None)
    return found


def problem_with(level: Level) -> str | None:
    """Why this is no level that can be played, or none."""
    height, width = level.grid.shape
    if not (0 < height <= LARGEST_SIDE and 0 < width <= LARGEST_SIDE):
        return f"a grid of {height}x{width}"
    if level.n_trains == 0:
        return "no trains"
    if level.n_trains > MOST_TRAINS:
        return f"{level.n_trains} trains: {MOST_TRAINS} are the most"
    if not 1 <= level.max_steps <= MOST_STEPS:
        return f"a step limit of {level.max_steps}: 1 to {MOST_STEPS} are possible"
    if level.max_steps * level.n_trains > MOST_TRAIN_STEPS:
        most = f"{MOST_TRAIN_STEPS} steps of all trains together are the most"
        return f"a step limit of {level.max_steps} for {level.n_trains} trains: {most}"
    problems = (_problem_with_train(level, train) for train in range(level.n_trains))
    problem = next((problem for problem in problems if problem is not None), None)
    return problem or (None if level.schedule is None else _problem_with_schedule(level.schedule))


def _problem_with_train(level: Level, train: int) -> str | None:
    height, width = level.grid.shape
    row, column, heading = level.starts[train].tolist()
    if not (0 <= row < height and 0 <= column < width and 0 <= heading < 4):
        return f"train {train} starts at row {row}, column {column}, heading {heading}"
    if level.grid[row, column] >> (4 * (3 - heading)) & 15 == 0:
        return f"train {train} starts at row {row}, column {column}, where no rail leads on for heading {heading}"
    goal_row, goal_column = level.targets[train].tolist()
    if not (0 <= goal_row < height and 0 <= goal_column < width) or level.grid[goal_row, goal_column] == 0:
        return f"the target of train {train} at row {goal_row}, column {goal_column} is not on rails"
    if (row, column) == (goal_row, goal_column):  # which rules and policies take in different ways
        return f"train {train} stands on its target at the start, row {row}, column {column}: move one of them"
    return None


def _problem_with_schedule(schedule: Schedule) -> str | None:
    malfunctions = schedule.malfunctions
    if malfunctions is not None and not (
        0 < malfunctions.rate <= 1 and 0 <= malfunctions.min_steps <= malfunctions.max_steps <= LATEST
    ):
        return (
            f"malfunctions of rate {malfunctions.rate:g} for {malfunctions.min_steps} to {malfunctions.max_steps} steps"
        )
    for train, (numerator, denominator) in enumerate(schedule.speeds.tolist()):
        if not 0 < numerator <= denominator:
            return f"train {train} has a speed of {numerator}/{denominator}, which is not above 0 and at most 1"
        departure, arrival = int(schedule.earliest_departures[train]), int(schedule.latest_arrivals[train])
        if departure < 0 or arrival < 0:
            return f"train {train} may depart from step {departure} and arrive until {arrival}"
        if not 0 <= schedule.target_headings[train] < 16:
            return f"train {train} has headings {schedule.target_headings[train]} at its target"
    if lcm(*(Fraction(*speed).denominator for speed in schedule.speeds.tolist())) > LARGEST_UNIT:
        return f"speeds with a common denominator above {LARGEST_UNIT}: use rounder ones"
    return None
