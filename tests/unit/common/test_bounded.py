"""Files of others are read as far as they may be expected to go, and nobody is waited for."""

import errno
import os

import pytest

from railctl.common.bounded import parse_json, read_bounded, read_json


def test_a_file_that_is_small_enough_is_read(tmp_path):
    (tmp_path / "a").write_bytes(b"12345")
    assert read_bounded(tmp_path / "a", 5) == b"12345"


def test_a_larger_one_is_not(tmp_path):
    (tmp_path / "a").write_bytes(b"123456")
    with pytest.raises(OSError, match="larger than 5e-06 MB") as caught:
        read_bounded(tmp_path / "a", 5)
    assert caught.value.errno == errno.EOVERFLOW


def test_of_a_huge_one_no_more_is_taken_than_is_allowed(tmp_path):
    with (tmp_path / "a").open("wb") as file:
        file.truncate(1 << 42)
    with pytest.raises(OSError, match=r"larger than 0\.001 MB"):
        read_bounded(tmp_path / "a", 1000)


def test_a_file_without_an_end_is_larger_than_anything():
    with pytest.raises(OSError, match=r"larger than 0\.001 MB"):
        read_bounded(os.path.realpath("/dev/zero"), 1000)


def test_nobody_is_waited_for_at_a_named_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert read_bounded(tmp_path / "pipe", 100) == b""


def test_a_pipe_that_somebody_writes_to_is_read_to_its_end():
    reading, writing = os.pipe()
    os.write(writing, b"a: 1")
    os.close(writing)
    assert read_bounded(f"/dev/fd/{reading}", 100) == b"a: 1"
    os.close(reading)


def test_json_that_is_nested_without_end_is_a_value_error(tmp_path):
    with pytest.raises(ValueError, match="nested too deeply"):
        parse_json("[" * 100_000)
    (tmp_path / "a.json").write_text('{"a": 1}')
    assert read_json(tmp_path / "a.json") == {"a": 1}
