"""The level bank: what is in it is what the generator makes, whoever builds it and however often they are killed."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from railctl.common.interpreter import PYTHON
from railctl.common.levels import build as building
from railctl.common.levels import chunks
from railctl.common.levels.bank import LevelBank
from railctl.common.levels.build import Progress, build
from railctl.common.levels.chunks import HEADER_BYTES, BankError, key_of
from railctl.common.levels.distributions import StockLevels, shipped
from railctl.common.levels.generate import generate as generate_any
from railctl.common.levels.level import InfeasibleLevelError
from railctl.common.levels.shipped import generate

EASY = shipped()["easy"]
RUSH = StockLevels.model_validate(
    {
        "rules": "stock",
        "size": [20, 24],
        "trains": 4,
        "cities": 2,
        "speeds": {1: 0.5, 0.5: 0.5},
        "malfunctions": {"rate": 0.002, "min_steps": 20, "max_steps": 50},
    }
)
SEEDS = list(range(100, 112))
CHUNK = 4
WORKER = f"""
import sys
from pathlib import Path
from railctl.common.levels import build
from railctl.common.levels.distributions import shipped
build.CHUNK_LEVELS = {CHUNK}
for count in build.work(Path(sys.argv[1]), shipped()["easy"], {SEEDS}):
    print(count, flush=True)
"""


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(building, "CHUNK_LEVELS", CHUNK)


def content(bank: LevelBank) -> dict[int, str]:
    return {seed: bank.get("easy", seed).content_hash for seed in sorted(bank.seeds("easy"))}


@pytest.fixture(scope="module")
def expected() -> dict[int, str]:
    return {seed: generate("easy", seed).content_hash for seed in SEEDS}


def start_worker(root: Path) -> subprocess.Popen:
    return subprocess.Popen([*PYTHON, "-c", WORKER, str(root)], stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize("difficulty", ["easy", "hard"])
def test_a_level_comes_back_as_it_was_generated(tmp_path: Path, difficulty):
    assert build(tmp_path, shipped()[difficulty], [5, 7]) == 2
    level, generated = LevelBank(tmp_path).get(difficulty, 7), generate(difficulty, 7)
    for name in ("grid", "starts", "targets"):
        ours, theirs = getattr(level, name), getattr(generated, name)
        np.testing.assert_array_equal(ours, theirs)
        assert ours.dtype == theirs.dtype
        assert ours.flags.writeable
        assert ours.flags.c_contiguous
    assert level.max_steps == generated.max_steps
    assert type(level.max_steps) is int
    assert level.content_hash == generated.content_hash


def test_what_is_not_there_is_none(tmp_path: Path):
    assert LevelBank(tmp_path / "nowhere").get("easy", 1) is None
    build(tmp_path, EASY, [1])
    bank = LevelBank(tmp_path)
    assert bank.get("easy", 2) is None
    assert bank.get("medium", 1) is None
    assert (bank.holds("easy", 1), bank.holds("easy", 2)) == (True, False)


def test_building_again_adds_only_what_is_missing(tmp_path: Path, expected):
    assert build(tmp_path, EASY, SEEDS[:6]) == 6
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "easy").iterdir()}
    assert build(tmp_path, EASY, SEEDS[:6]) == 0
    assert build(tmp_path, EASY, [*SEEDS, *SEEDS]) == 6
    assert content(LevelBank(tmp_path)) == expected
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_an_open_bank_sees_new_chunks_after_refresh(tmp_path: Path):
    build(tmp_path, EASY, SEEDS[:4])
    bank = LevelBank(tmp_path)
    build(tmp_path, EASY, SEEDS)
    assert not bank.holds("easy", SEEDS[-1])
    bank.refresh()
    assert bank.seeds("easy") == set(SEEDS)


def test_progress_goes_from_what_is_there_to_all(tmp_path: Path):
    build(tmp_path, EASY, SEEDS[:4])
    seen: list[Progress] = []
    build(tmp_path, EASY, SEEDS, on_progress=seen.append)
    assert [(progress.done, progress.total) for progress in seen] == [(4, 12), (8, 12), (12, 12)]
    assert seen[0].seconds_left is None
    assert seen[1].seconds_left > 0
    assert seen[-1].seconds_left == 0


def test_several_processes_build_the_same_bank(tmp_path: Path, expected):
    assert build(tmp_path / "ours", EASY, SEEDS, processes=2) == 12
    assert content(LevelBank(tmp_path / "ours")) == expected


def test_builders_that_do_not_know_of_each_other_share_the_work(tmp_path: Path, expected):
    workers = [start_worker(tmp_path) for _ in range(2)]
    counts = [int(line) for worker in workers for line in worker.communicate()[0].split()]
    assert sum(counts) == len(SEEDS)
    assert content(LevelBank(tmp_path)) == expected
    assert all(path.suffix == chunks.SUFFIX for path in (tmp_path / "easy").iterdir())


@pytest.mark.parametrize("chunks_before", [0, 2])
def test_a_kill_loses_no_chunk_and_leaves_nothing_broken(tmp_path: Path, expected, chunks_before: int):
    worker = start_worker(tmp_path)
    for _ in range(chunks_before):
        worker.stdout.readline()
    while not list((tmp_path / "easy").glob("*.claim")) and worker.poll() is None:
        time.sleep(0.001)
    worker.send_signal(signal.SIGKILL)
    worker.communicate()
    survived = content(LevelBank(tmp_path))
    assert len(survived) >= chunks_before * CHUNK
    assert survived.items() <= expected.items()
    assert build(tmp_path, EASY, SEEDS) == len(SEEDS) - len(survived)
    assert content(LevelBank(tmp_path)) == expected


def test_torn_files_of_a_dead_builder_are_ignored_and_cleared(tmp_path: Path, expected):
    name = chunks.chunk_name(EASY, SEEDS[:CHUNK])
    torn = tmp_path / "easy" / f".{name}.12345.tmp"
    torn.parent.mkdir()
    torn.write_bytes(b"half a chunk")
    (tmp_path / "easy" / f".{name}.claim").touch()
    assert LevelBank(tmp_path).seeds("easy") == set()
    build(tmp_path, EASY, SEEDS)
    assert content(LevelBank(tmp_path)) == expected
    assert not torn.exists()


def only_chunk(root: Path) -> Path:
    build(root, EASY, SEEDS[:2])
    [path] = (root / "easy").glob(f"*{chunks.SUFFIX}")
    return path


def test_a_changed_byte_is_found_when_its_level_is_read(tmp_path: Path):
    path = only_chunk(tmp_path)
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    bank = LevelBank(tmp_path)
    assert bank.get("easy", SEEDS[0]).content_hash == generate("easy", SEEDS[0]).content_hash
    with pytest.raises(BankError, match=f"{path} holds another level in place 1 than was written: delete it"):
        bank.get("easy", SEEDS[1])


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda data: data[:-1], "is not as long as its header says"),
        (lambda data: data[:100], "cannot be read"),
        (lambda data: b"\0" * len(data), "cannot be read"),
        (lambda data: b"[]".ljust(HEADER_BYTES) + data[HEADER_BYTES:], "has no proper header"),
    ],
)
def test_a_damaged_file_is_refused_by_name(tmp_path: Path, damage, problem: str):
    path = only_chunk(tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(BankError, match=f"{path} {problem}"):
        LevelBank(tmp_path)


@pytest.mark.parametrize(("key", "value"), [("format", 99), ("generator", "other-1"), ("difficulty", "hard")])
def test_a_bank_of_another_kind_is_refused(tmp_path: Path, key: str, value: object):
    path = only_chunk(tmp_path)
    data = path.read_bytes()
    header = json.loads(data[:HEADER_BYTES]) | {key: value}
    path.write_bytes(json.dumps(header).encode().ljust(HEADER_BYTES) + data[HEADER_BYTES:])
    with pytest.raises(BankError, match=f"has {key} {value!r}, not"):
        LevelBank(tmp_path)


def test_a_worker_that_cannot_go_on_is_an_error_with_its_reason(tmp_path: Path):
    (tmp_path / "easy").mkdir()
    os.chmod(tmp_path / "easy", 0o500)  # noqa: PTH101
    if os.access(tmp_path / "easy", os.W_OK):  # as root nothing is refused
        (tmp_path / "easy").rmdir()
        (tmp_path / "easy").write_text("not a folder")
    with pytest.raises(BankError, match=r"no worker could finish .*: .*: build again"):
        build(tmp_path, EASY, SEEDS, processes=2)


def test_reading_a_level_takes_microseconds(tmp_path: Path):
    build(tmp_path, shipped()["hard"], SEEDS[:2])
    bank = LevelBank(tmp_path)
    durations = []
    for _ in range(300):
        begin = time.perf_counter()
        bank.get("hard", SEEDS[0])
        durations.append(time.perf_counter() - begin)
    assert np.median(durations) < 100e-6  # a few in truth


def test_schedules_come_back_as_they_were_generated(tmp_path: Path):
    assert build(tmp_path, RUSH, [5, 7]) == 2
    level, generated = LevelBank(tmp_path).get(key_of(RUSH), 7), generate_any(RUSH, 7)
    assert level.content_hash == generated.content_hash
    for name in ("speeds", "earliest_departures", "latest_arrivals", "target_headings"):
        np.testing.assert_array_equal(getattr(level.schedule, name), getattr(generated.schedule, name))
        assert getattr(level.schedule, name).dtype == np.int32
    assert level.schedule.malfunctions == generated.schedule.malfunctions == (0.002, 20, 50)


def test_equal_distributions_share_their_levels_whatever_they_are_called(tmp_path: Path):
    same = StockLevels.model_validate(json.loads(RUSH.model_dump_json()))
    assert build(tmp_path, RUSH, [1]) == 1
    assert build(tmp_path, same, [1]) == 0
    assert build(tmp_path, RUSH.model_copy(update={"trains": 3}), [1]) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(LevelBank(tmp_path).keys())
    assert key_of(EASY.model_copy()) == "easy"


def test_an_old_bank_is_read_and_its_chunks_keep_their_names(tmp_path: Path):
    build(tmp_path, EASY, [5, 7])
    [path] = (tmp_path / "easy").iterdir()
    assert path.name == "6871ef81fabfa0e1b1c109952f8ef1d1.levels"
    header = json.loads(path.read_bytes()[:HEADER_BYTES])
    assert (header["format"], header["generator"], header["difficulty"]) == (1, "legacy-1", "easy")


def test_large_levels_come_in_small_chunks(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(building, "CHUNK_LEVELS", 128)
    assert [building.chunk_levels(levels) for levels in shipped().values()] == [128] * 3
    large = RUSH.model_copy(update={"size": (100, 100), "trains": 200})
    assert 1 <= building.chunk_levels(large) < 10


@pytest.mark.parametrize("processes", [1, 2])
def test_a_seed_without_a_level_is_named(tmp_path: Path, processes: int):
    impossible = RUSH.model_copy(update={"size": (6, 6)})
    with pytest.raises(InfeasibleLevelError, match="6x6 has no room for two cities"):
        build(tmp_path, impossible, SEEDS, processes)
