"""Files that are broken or meant to harm: one line each, soon, whatever they announce, and nothing is ever called."""

import io
import os
import pickle
import resource
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fuzzing import FUZZ_CASES, cases, fuzz
from hypothesis import given
from hypothesis import strategies as st
from saved import LEVEL, Saved, effects_in_each_other, packed, pickled, static, third

from railctl.common.levels import files
from railctl.common.levels.files import LevelFileError
from railctl.common.levels.flatland.reading import read_level
from railctl.common.levels.reading import read

SECONDS = 20.0  # of the processor, on a machine with much else to do; what is not bounded takes minutes or for ever
SECONDS_A_CASE = 0.02
MEGABYTES = 1200


@pytest.fixture(autouse=True)
def within_bounds() -> Iterator[None]:
    """No test of this file takes long, or much memory."""
    used, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    yield
    assert time.process_time() - began < SECONDS + SECONDS_A_CASE * int(os.environ.get(FUZZ_CASES, "0"))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - used < MEGABYTES * 1024


def refusal(folder: Path, data: bytes, name: str = "level.pkl") -> str:
    path = folder / name
    path.write_bytes(data)
    with pytest.raises(LevelFileError) as error:
        read(path)
    text = str(error.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    assert len(text) < len(str(path)) + 200
    return text


class Evil:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("wrap", [lambda evil: evil, lambda evil: {"grid": evil, "agents": [evil]}])
def test_a_pickle_cannot_call_anything(tmp_path: Path, wrap: Any):
    target = tmp_path / "made by a pickle"
    assert "is not as any version of flatland-rl saves" in refusal(tmp_path, pickle.dumps(wrap(Evil(target))))
    assert not target.exists()


@pytest.mark.parametrize(
    "number",
    ["1e300000000", "9" * 5000, "1/0", "1/-3", "nan", " 1 ", "1_0/2", "\u0661/\u0662", "0x1/2", 10**30, None, -1],
)
def test_fractions_are_of_two_whole_numbers(tmp_path: Path, number: Any):
    refusal(tmp_path, pickled(third((0.5, Saved("fractions.Fraction", number)))))


DEEP = 300_000


def nested(depth: int, opcode: bytes) -> bytes:
    return b"\x80\x04" + b")" + opcode * depth + b"."


def doubled(times: int, begin: bytes = b")") -> bytes:
    """A tuple of twice the same, again and again: 2 ** times items to whoever goes through all."""
    return b"\x80\x04" + begin + (b"2\x86" * times)


DEEP_LIST = b"\x80\x04" + b"]" * DEEP + b"a" * (DEEP - 1) + b"."
PICKLES = {
    "deep tuples": nested(DEEP, b"\x85"),
    "deep lists": DEEP_LIST,
    "deep keys": b"\x80\x04}" + b")" + b"\x85" * DEEP + b"K\x01s.",
    "deep items of a set": b"\x80\x04\x8f(" + b")" + b"\x85" * DEEP + b"\x90.",
    "doubled keys": b"\x80\x04}" + doubled(100)[2:] + b"K\x01s.",
    "doubled items of a set": b"\x80\x04\x8f(" + doubled(100)[2:] + b"\x90.",
    "doubled items of a frozen set": b"\x80\x04(" + doubled(100)[2:] + b"\x91.",
    "a memo of any size": b"\x80\x04N" + b"r" + struct.pack("<I", 2**32 - 1) + b".",
    "bytes of any length": b"\x80\x04\x8e" + struct.pack("<Q", 2**62) + b"x.",
    "a byte array of any length": b"\x80\x05\x96" + struct.pack("<Q", 2**40) + b"x.",
    "a frame of any length": b"\x80\x04\x95" + struct.pack("<Q", 2**62) + b"N.",
    "many parts": b"\x80\x04" + b"}" * 4_000_000 + b".",
    "many classes": b"\x80\x04" + b"".join(b"ca\n%d\n" % at for at in range(100_000)) + b".",
    "a stack that is empty": b"\x80\x04" + b"0" * 100 + b".",
    "a list in itself": b"\x80\x04]q\x00h\x00a.",
    "text for a number": b"\x80\x04L" + b"9" * 1_000_000 + b"L\n.",
    "outside references": b"\x80\x04Pa\n.",
    "extensions": b"\x80\x04\x82\x01.",
}


@pytest.mark.parametrize("name", PICKLES)
def test_pickles_that_announce_or_refer_to_more_than_they_hold(tmp_path: Path, name: str):
    refusal(tmp_path, PICKLES[name])


MSGPACKS = {
    "an array of any length": b"\x82\xa4grid\xdd\xff\xff\xff\xff",
    "arrays of any length in each other": b"\x81\xa4grid" + b"\xdd\x7f\xff\xff\xff" * 500,
    "long arrays in each other": b"\x81\xa4grid" + b"\xdc\x27\x10" * 1_000_000,
    "a dictionary of any length": b"\xdf\xff\xff\xff\xff",
    "bytes of any length": b"\x81\xa4grid\xc6\xff\xff\xff\xff",
    "deep arrays": b"\x81\xa4grid" + b"\x91" * 5_000_000 + b"\xc0",
    "deep dictionaries": b"\x81\xa4grid" * 500_000 + b"\xc0",
    "many dictionaries": b"\x81\xa4grid\xdc\x27\x10" + (b"\xdc\x27\x10" + b"\x80" * 10_000) * 2000,
    "extensions": b"\x81\xa4grid\xc7\xff\x01",
    "keys that are arrays": b"\x81\x92\x01\x02\x01",
    "no dictionary": b"\xde",
}


@pytest.mark.parametrize("name", MSGPACKS)
def test_msgpack_that_announces_more_than_it_holds(tmp_path: Path, name: str):
    refusal(tmp_path, MSGPACKS[name])


def array(kind: str, shape: tuple[int, int], data: bytes) -> dict[str, Any]:
    return {"grid": {b"nd": True, b"type": kind, b"shape": shape, b"data": data}}


ROW = [0] * 4096
ENDS = [((1, 5), heading) for heading in range(4)] * 4000
FIELDS = third()["agents"][0].arguments
BIG = {f"key {at}": 0 for at in range(9000)}
DOCUMENTS = {
    "one row again and again": {"grid": [ROW] * 4096, "agents": []},
    "one long list of targets for all": {
        "grid": LEVEL.grid.tolist(),
        "agents": [Saved("flatland.envs.agent_utils.Agent", *FIELDS[:3], ENDS, *FIELDS[4:])] * 9000,
    },
    "one large dictionary for all numbers": {"grid": [[BIG] * 4096] * 200, "agents": []},
    "effects of effects": third(effects_generator=effects_in_each_other(8, 90)),
    "one train again and again": {"grid": LEVEL.grid.tolist(), "agents": third()["agents"] * 6000},
    "a huge number": third((0.5, 10**4000)),
    "a huge limit": third(max_episode_steps=10**4000),
    "infinity": third(max_episode_steps=float("inf")),
    "an array of any shape": static(3) | array("<i8", (2**31, 2**31), b""),
    "an array of objects": static(3) | array("|O", (1, 1), b"12345678"),
    "an array of a long type": static(3) | array("i4," * 9, (1, 1), b""),
}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_documents_that_repeat_themselves(tmp_path: Path, name: str):
    refusal(tmp_path, pickled(DOCUMENTS[name]))


def test_a_list_that_is_its_own_row_is_no_grid(tmp_path: Path):
    grid: list[Any] = []
    grid.append(grid)
    assert "is not as any version" in refusal(tmp_path, pickled({"grid": grid, "agents": [grid]}))


def archive() -> bytes:
    file = io.BytesIO()
    path = Path("/dev/shm") if Path("/dev/shm").exists() else Path("/tmp")  # noqa: S108
    whole = path / f"levels-{os.getpid()}.npz"
    try:
        files.save(whole, {"made": [LEVEL]})
        file.write(whole.read_bytes())
    finally:
        whole.unlink()
    return file.getvalue()


WHOLE = {"third.pkl": pickled(third()), "static.mpk": packed(static(6)), "ours.npz": archive()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for all cases: to number a folder, pytest reads the names of all there are."""
    return tmp_path_factory.mktemp("broken")


@fuzz
@pytest.mark.parametrize("name", WHOLE)
@cases(150)
@given(data=st.data())
def test_what_is_cut_or_flipped_is_a_level_or_refused_in_one_line(folder: Path, name: str, data: st.DataObject):
    broken = bytearray(WHOLE[name])
    for at in data.draw(st.lists(st.integers(0, 8 * len(broken) - 1), max_size=4)):
        broken[at // 8] ^= 1 << at % 8
    path = folder / name
    path.write_bytes(broken[: data.draw(st.integers(0, len(broken)) | st.just(len(broken)))])
    try:
        found = read(path)
    except LevelFileError as error:
        assert str(error).startswith(str(path))  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
    else:
        for levels in found.groups.values():
            assert all(files.problem_with(level) is None for level in levels)


def test_what_cannot_be_opened_is_named(tmp_path: Path):
    with pytest.raises(LevelFileError, match="no such file"):
        read(tmp_path / "other.pkl")
    with pytest.raises(LevelFileError, match="Is a directory"):
        read_level(tmp_path)
