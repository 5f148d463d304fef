"""Row files: a line that was cut off in mid-write never counts, and a damaged one is named."""

import gc
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_rows import episode_row

from railctl.common import rows as rows_module
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import DamagedRows, RowFile, last_rows, read_rows


def row(number, value=-0.5):
    return episode_row(number, seed=7, normalised_return=value, digest=f"{number:032x}", trained_unix_s=1000.125)


def written(path, count):
    file = RowFile(path, EpisodeRow)
    for number in range(count):
        file.append(row(number))
    file.close()
    return path


def test_no_file_has_no_rows(tmp_path):
    assert read_rows(tmp_path / "none.jsonl", EpisodeRow) == []
    assert not (tmp_path / "none.jsonl").exists()


def test_rows_come_back_and_each_is_readable_at_once(tmp_path):
    path = tmp_path / "rows.jsonl"
    file = RowFile(path, EpisodeRow)
    for number in range(3):
        file.append(row(number))
        assert read_rows(path, EpisodeRow) == list(file.read()) == [row(n) for n in range(number + 1)]
    file.close()
    assert path.read_bytes().count(b"\n") == 3


@settings(deadline=None, max_examples=50)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_come_back_to_the_last_bit(tmp_path_factory, value):
    path = tmp_path_factory.mktemp("rows") / "rows.jsonl"
    file = RowFile(path, EpisodeRow)
    file.append(row(0, value))
    file.close()
    [back] = read_rows(path, EpisodeRow)
    assert repr(back.normalised_return) == repr(value)


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_a_file_cut_anywhere_holds_the_first_rows_and_goes_on_from_there(tmp_path_factory, data):
    path = written(tmp_path_factory.mktemp("rows") / "rows.jsonl", 3)
    whole = path.read_bytes()
    size = data.draw(st.integers(0, len(whole)))
    path.write_bytes(whole[:size])
    kept = whole[:size].count(b"\n")
    expected = [row(number) for number in range(kept)]
    assert read_rows(path, EpisodeRow) == expected
    assert path.stat().st_size == size  # reading changes nothing

    file = RowFile(path, EpisodeRow)
    assert list(file.read()) == expected
    assert path.read_bytes() == b"".join(whole.splitlines(keepends=True)[:kept])
    for number in range(kept, 3):
        file.append(row(number))
    file.close()
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{",
        b"5",
        b"null",
        b"\xff\xfe",
        b'{"episode": 1}',
        b"[" * 5000,
        b"x" * 200_000,
        row(1).model_dump_json(by_alias=True).replace("-0.5", "NaN").encode(),
        row(1).model_dump_json(by_alias=True).replace('"easy"', '"no name"').encode(),
        row(1).model_dump_json(by_alias=True).replace('"level"', '"colour"').encode(),
    ],
)
def test_a_damaged_line_before_the_end_is_named(tmp_path, line):
    path = written(tmp_path / "rows.jsonl", 3)
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join([lines[0], line, *lines[2:]]))
    before = path.read_bytes()
    for read in (read_rows, RowFile):
        with pytest.raises(DamagedRows) as caught:
            read(path, EpisodeRow)
        assert str(caught.value) == (
            f"{path} line 2 is not a valid row: delete this and all later lines to lose only those"
        )
    assert path.read_bytes() == before


@pytest.mark.parametrize(("count", "first"), [(2, 3), (5, 0), (9, 0)])
def test_the_last_rows_are_read_and_the_others_counted(tmp_path, count, first):
    path = written(tmp_path / "rows.jsonl", 5)
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([b"nonsense" if first else lines[0], *lines[1:], b'{"epi']))  # the last is torn
    assert last_rows(path, EpisodeRow, count) == (5, [row(number) for number in range(first, 5)])


def test_of_no_file_there_are_no_last_rows(tmp_path):
    assert last_rows(tmp_path / "none.jsonl", EpisodeRow, 3) == (0, [])


def test_a_damaged_line_among_the_last_is_named(tmp_path):
    path = written(tmp_path / "rows.jsonl", 5)
    path.write_bytes(path.read_bytes() + b"nonsense\n")
    with pytest.raises(DamagedRows, match="line 6 is not a valid row"):
        last_rows(path, EpisodeRow, 2)


def test_cutting_returns_what_it_cuts_off_and_the_file_goes_on(tmp_path):
    path = written(tmp_path / "rows.jsonl", 5)
    file = RowFile(path, EpisodeRow)
    assert file.cut(2) == [row(2), row(3), row(4)]
    assert read_rows(path, EpisodeRow) == list(file.read()) == [row(0), row(1)]
    file.append(row(9))
    assert read_rows(path, EpisodeRow) == list(file.read()) == [row(0), row(1), row(9)]
    assert file.cut(3) == []
    assert file.cut(7) == []
    assert file.cut(0) == [row(0), row(1), row(9)]
    assert path.read_bytes() == b""
    file.close()


def test_whoever_waits_hears_of_each_row_that_is_read(tmp_path):
    heard = []
    file = RowFile(written(tmp_path / "rows.jsonl", 5), EpisodeRow, lambda: heard.append(None))
    assert len(heard) == 5
    assert len(list(file.read(3))) == 2
    assert len(heard) == 7
    file.close()


def test_rows_are_on_disk_when_sync_returns(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(os.fstat(number).st_size))
    path = tmp_path / "rows.jsonl"
    file = RowFile(path, EpisodeRow)
    file.append(row(0))
    file.sync()
    file.close()
    assert synced == [path.stat().st_size]


def test_any_stretch_can_be_read_and_any_be_cut_off(tmp_path, monkeypatch):
    monkeypatch.setattr(rows_module, "STRIDE", 3)
    file = RowFile(written(tmp_path / "rows.jsonl", 8), EpisodeRow)
    expected = [row(number) for number in range(8)]
    for kept in (8, 7, 6, 4, 3, 1, 0):
        file.cut(kept)
        assert file.count == kept
        for first in range(9):
            assert list(file.read(first)) == expected[first:kept]
            assert list(file.read(first, 3)) == expected[first:kept][:3]
        for number in range(kept, 8):
            file.append(row(number))
        assert list(file.read()) == expected
    file.close()


def test_rows_stay_on_disk(tmp_path):
    before = objects()
    file = RowFile(written(tmp_path / "rows.jsonl", 2000), EpisodeRow)
    for number in range(2000, 4000):
        file.append(row(number))
    assert objects() == before
    assert file.count == 4000
    assert next(file.read(3999)) == row(3999)
    assert len(file._places) == 4000 // rows_module.STRIDE
    file.close()


def objects():
    gc.collect()
    return sum(type(found) is EpisodeRow for found in gc.get_objects())


def test_a_file_without_a_line_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "rows.jsonl"
    with path.open("wb") as file:
        file.truncate(1 << 42)
    with pytest.raises(DamagedRows, match="line 1 is not a valid row"):
        read_rows(path, EpisodeRow)
    with pytest.raises(DamagedRows, match="line 1 is not a valid row"):
        last_rows(path, EpisodeRow, 1)
