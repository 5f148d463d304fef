"""Files of levels: what goes in comes out, and what is no level is refused by name."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from railctl.common.levels import files
from railctl.common.levels.files import LevelFileError
from railctl.common.levels.level import Level, Malfunctions, Schedule
from railctl.common.levels.shipped import generate

LEVELS = [generate("easy", seed) for seed in range(3)]


def hashes(levels: list[Level]) -> list[str]:
    return [level.content_hash for level in levels]


def test_groups_come_back_as_they_were(tmp_path: Path):
    groups = {"easy": LEVELS, "hard": [generate("hard", 1)]}
    files.save(tmp_path / "levels.npz", groups)
    back = files.load(tmp_path / "levels.npz")
    assert {name: hashes(levels) for name, levels in back.items()} == {
        name: hashes(levels) for name, levels in groups.items()
    }
    assert [path.name for path in tmp_path.iterdir()] == ["levels.npz"]


def test_equal_levels_make_equal_files(tmp_path: Path):
    for name in ("a.npz", "b.npz"):
        files.save(tmp_path / name, {"easy": LEVELS})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_levels_of_two_shapes_are_no_group(tmp_path: Path):
    with pytest.raises(LevelFileError, match="levels of mixed differ"):
        files.save(tmp_path / "levels.npz", {"mixed": [LEVELS[0], generate("hard", 1)]})


GOOD = {
    "easy_levels_grid": LEVELS[0].grid[None],
    "easy_levels_agents": np.concatenate([LEVELS[0].starts, LEVELS[0].targets], axis=1)[None],
    "easy_levels_max_steps": np.array([412]),
}
OFF_RAILS = GOOD["easy_levels_agents"].copy()
OFF_RAILS[0, 1, :2] = 0
OUTSIDE = GOOD["easy_levels_agents"].copy()
OUTSIDE[0, 2, 3] = 25
ON_TARGET = GOOD["easy_levels_agents"].copy()
ON_TARGET[0, 1, 3:] = ON_TARGET[0, 1, :2]


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"easy_levels_grid": None}, "no array named <group>_levels_grid"),
        ({"easy_levels_max_steps": None}, "lacks the array easy_levels_max_steps"),
        ({"easy_levels_max_steps": np.array([412.0])}, "must hold integers"),
        ({"easy_levels_max_steps": np.array([412, 1])}, r"do not have shapes \[K, H, W\]"),
        ({"easy_levels_max_steps": np.array([0])}, "level 0 of easy: a step limit of 0"),
        ({"easy_levels_max_steps": np.array([100_001])}, "a step limit of 100001: 1 to 100000 are possible"),
        (
            {
                "easy_levels_agents": np.repeat(GOOD["easy_levels_agents"], 400, 1),
                "easy_levels_max_steps": np.array([100_000]),
            },
            "a step limit of 100000 for 1200 trains: 100000000 steps of all trains together are the most",
        ),
        ({"easy_levels_agents": np.zeros((1, 3, 4), int)}, r"do not have shapes \[K, H, W\]"),
        ({"easy_levels_agents": np.zeros((1, 0, 5), int)}, "level 0 of easy: no trains"),
        ({"easy_levels_agents": OFF_RAILS}, "train 1 starts at row 0, column 0, where no rail leads on"),
        ({"easy_levels_agents": OUTSIDE}, "the target of train 2 at row 25, column .* is not on rails"),
        ({"easy_levels_agents": ON_TARGET}, "train 1 stands on its target at the start, row .*: move one of them"),
        ({"easy_levels_grid": GOOD["easy_levels_grid"].astype(int) + (1 << 16)}, "beyond 16 bits"),
        ({"easy_levels_agents": GOOD["easy_levels_agents"].astype(int) + (1 << 32)}, "beyond 31 bits"),
        ({"easy_levels_max_steps": np.array([-1])}, "numbers below 0"),
    ],
)
def test_what_is_no_level_is_named(tmp_path: Path, changes: dict, problem: str):
    path = tmp_path / "levels.npz"
    np.savez(path, **{name: array for name, array in (GOOD | changes).items() if array is not None})
    with pytest.raises(LevelFileError, match=problem):
        files.load(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing", b"text", pickle.dumps([1])])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes):
    path = tmp_path / "levels.npz"
    path.write_bytes(content)
    with pytest.raises(LevelFileError, match=r"no readable \.npz"):
        files.load(path)
    with pytest.raises(LevelFileError, match="no such file"):
        files.load(tmp_path / "other.npz")


SCHEDULE = Schedule(
    speeds=np.array([[1, 1], [1, 3], [2, 5]], np.int32),
    earliest_departures=np.array([0, 7, 2], np.int32),
    latest_arrivals=np.array([90, 2**31 - 1, 0], np.int32),
    target_headings=np.array([0, 5, 15], np.int32),
    malfunctions=Malfunctions(0.01, 2, 9),
)


def test_schedules_come_back_with_levels_that_have_none(tmp_path: Path):
    calm = replace(SCHEDULE, malfunctions=None)
    levels = [LEVELS[0], replace(LEVELS[1], schedule=SCHEDULE), replace(LEVELS[2], schedule=calm)]
    files.save(tmp_path / "levels.npz", {"easy": levels, "plain": LEVELS})
    back = files.load(tmp_path / "levels.npz")
    assert {name: hashes(some) for name, some in back.items()} == {"easy": hashes(levels), "plain": hashes(LEVELS)}
    assert [level.schedule is None for level in back["easy"]] == [True, False, False]


def test_levels_without_schedules_make_the_files_of_before(tmp_path: Path):
    files.save(tmp_path / "levels.npz", {"easy": LEVELS})
    with files.opened(tmp_path / "levels.npz") as stored:
        assert set(stored) == {"easy_levels_grid", "easy_levels_agents", "easy_levels_max_steps"}


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"speeds": None}, "lacks the array easy_levels_speeds"),
        ({"malfunctions": None}, "lacks the array easy_levels_malfunctions"),
        ({"speeds": np.ones((1, 3, 2))}, r"easy_levels_speeds is no array of integer of shape \[1, 3, 2\]"),
        ({"departures": np.zeros((1, 2), int)}, r"easy_levels_departures is no array of integer of shape \[1, 3\]"),
        ({"departures": np.array([[0, 2**40, 0]])}, "easy_levels_departures holds numbers beyond 32 bits"),
        ({"malfunctions": np.array([[np.nan, 1, 1]])}, "easy_levels_malfunctions holds numbers beyond 32 bits"),
        ({"malfunctions": np.array([[2.0, 1, 1]])}, "malfunctions of rate 2 for 1 to 1 steps"),
        ({"malfunctions": np.array([[0.5, 9, 1]])}, "malfunctions of rate 0.5 for 9 to 1 steps"),
        ({"speeds": np.array([[[1, 1], [0, 1], [1, 1]]])}, "train 1 has a speed of 0/1, which is not above 0"),
        ({"speeds": np.array([[[1, 1], [3, 2], [1, 1]]])}, "train 1 has a speed of 3/2, which is not above 0"),
        ({"speeds": np.array([[[1, 1009], [1, 1013], [1, 1019]]])}, "a common denominator above 1048576"),
        ({"departures": np.array([[0, -1, 0]])}, "train 1 may depart from step -1"),
        ({"target_headings": np.array([[0, 16, 0]])}, "train 1 has headings 16 at its target"),
    ],
)
def test_schedules_are_read_strictly(tmp_path: Path, changes: dict, problem: str):
    path = tmp_path / "levels.npz"
    files.save(path, {"easy": [replace(LEVELS[0], schedule=SCHEDULE)]})
    with files.opened(path) as stored:
        arrays = dict(stored) | {f"easy_levels_{name}": array for name, array in changes.items()}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(LevelFileError, match=problem) as error:
        files.load(path)
    assert "\n" not in str(error.value)


def test_an_array_that_would_fill_the_memory_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(files, "MOST_ARRAY_BYTES", 1_000_000)
    path = tmp_path / "levels.npz"
    np.savez_compressed(path, a_levels_grid=np.zeros((1000, 1000), np.uint8))
    assert path.stat().st_size < 10_000
    with pytest.raises(LevelFileError, match="the array a_levels_grid has over 1000000 bytes: split the file"):
        files.load(path)


def test_a_file_whose_arrays_are_too_large_together_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "levels.npz"
    np.savez_compressed(path, **GOOD)
    monkeypatch.setattr(files, "MOST_FILE_BYTES", 1000)
    with pytest.raises(LevelFileError, match="its arrays have over 1000 bytes: split it"):
        files.load(path)
    np.savez(path, **GOOD)
    with pytest.raises(LevelFileError, match=r"levels\.npz has over 1000 bytes: split it"):
        files.load(path)


@pytest.mark.parametrize("begin", [b"", b"\x93NUMPY", b"hello"])
def test_of_a_huge_file_that_is_no_archive_the_beginning_is_enough(tmp_path: Path, begin: bytes):
    path = tmp_path / "levels.npz"
    path.write_bytes(begin)
    with path.open("r+b") as file:
        file.truncate(1 << 42)
    with pytest.raises(LevelFileError):
        files.load(path)
