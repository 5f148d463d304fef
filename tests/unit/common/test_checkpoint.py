"""Files come back whole or are refused in one clear line."""

import os
import subprocess
from unittest.mock import Mock

import numpy as np
import pytest
import safetensors.numpy
from fuzzing import cases, fuzz
from hypothesis import given
from hypothesis import strategies as st

from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError, from_bytes, load, save, to_bytes
from railctl.common.interpreter import PYTHON

METADATA = {"config": '{"seed": 1, "é": "ü"}', "episode": "50", "algorithm": "dqn"}


def tensors():
    return {
        "network/q.weight": np.arange(6, dtype=np.float32).reshape(2, 3),
        "replay/action": np.array([1, -2, 3], np.int8),
        "replay/empty": np.zeros((0, 4), np.float32),
        "trainer/steps": np.array(7, np.int64),
        "flags": np.array([True, False]),
    }


def assert_same(ours, theirs):
    assert sorted(ours) == sorted(theirs)
    for name, array in ours.items():
        assert theirs[name].dtype == array.dtype
        assert theirs[name].shape == array.shape
        np.testing.assert_array_equal(theirs[name], array)


def refusal(path, kind="snapshot"):
    with pytest.raises(CheckpointError) as caught:
        load(path, kind)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


def test_a_file_comes_back_whole(tmp_path):
    path = tmp_path / "50.safetensors"
    save(path, tensors(), METADATA, "snapshot")
    loaded, metadata = load(path, "snapshot")
    assert_same(tensors(), loaded)
    assert metadata == {**METADATA, "kind": "snapshot", "format": "1", "digest": metadata["digest"]}
    assert [entry.name for entry in tmp_path.iterdir()] == ["50.safetensors"]


def test_a_file_is_replaced(tmp_path):
    path = tmp_path / "a.safetensors"
    save(path, tensors(), METADATA, "snapshot")
    save(path, {"x": np.ones(2)}, {}, "snapshot")
    assert list(load(path, "snapshot")[0]) == ["x"]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.safetensors"
    save(path, tensors(), METADATA, "snapshot")

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        save(path, {"x": np.ones(2)}, {}, "snapshot")
    monkeypatch.undo()
    assert_same(tensors(), load(path, "snapshot")[0])
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.safetensors"]


def test_equal_content_has_equal_bytes():
    many = {f"key{i}": "x" for i in range(20)}
    backwards = dict(reversed(many.items()))
    first = to_bytes(tensors(), many, "snapshot")
    assert first == to_bytes(dict(reversed(tensors().items())), backwards, "snapshot")
    assert_same(tensors(), safetensors.numpy.load(first))  # any reader of safetensors reads it


def test_memory_layout_does_not_matter():
    dense = np.arange(6, dtype=np.float32).reshape(2, 3)
    plain = to_bytes({"x": dense}, {}, "snapshot")
    for layout in (np.asfortranarray(dense), dense.astype(">f4"), np.repeat(dense, 2, axis=1)[:, ::2]):
        assert to_bytes({"x": layout}, {}, "snapshot") == plain


@pytest.mark.parametrize("dtype", ["U4", "object", "complex128", "longdouble", "datetime64[s]"])
def test_what_safetensors_cannot_keep_is_refused(dtype):
    array = np.zeros(2, dtype)
    with pytest.raises(ValueError, match="tensor x has dtype"):
        to_bytes({"x": array}, {}, "snapshot")


@pytest.mark.parametrize("dtype", ["?", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8"])
def test_every_other_dtype_comes_back(dtype):
    kept = {"x": np.array([[0, 1, 0]], dtype)}
    assert_same(kept, from_bytes(to_bytes(kept, {}, "snapshot"), "snapshot", "memory")[0])


@pytest.mark.parametrize("name", ["kind", "format", "digest"])
def test_our_metadata_names_are_reserved(name):
    with pytest.raises(ValueError, match=f"metadata {name} is set here"):
        to_bytes({}, {name: "0"}, "snapshot")


def test_the_tensor_name_of_safetensors_itself_is_refused():
    with pytest.raises(ValueError, match="__metadata__"):
        to_bytes({"__metadata__": np.zeros(1)}, {}, "snapshot")


def test_a_missing_file(tmp_path):
    assert "no such file" in refusal(tmp_path / "none.safetensors")


def test_what_is_no_file_or_cannot_be_read(tmp_path, monkeypatch):
    assert "is no file: check the path" in refusal(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    assert "is no file: check the path" in refusal(tmp_path / "pipe")
    path = tmp_path / "a.safetensors"
    path.touch()
    monkeypatch.setattr(
        "railctl.common.checkpoint.open_at_once", Mock(side_effect=PermissionError(13, "Permission denied"))
    )
    assert "cannot be read (Permission denied)" in refusal(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"\xff" * 100, b"\x02" + bytes(7) + b"[]"])
def test_another_kind_of_file(tmp_path, content):
    path = tmp_path / "a.safetensors"
    path.write_bytes(content)
    assert "not a safetensors file" in refusal(path)


def test_a_file_of_a_dtype_that_numpy_lacks(tmp_path):
    path = tmp_path / "a.safetensors"
    header = b'{"x":{"dtype":"BF16","shape":[1],"data_offsets":[0,2]}}'
    path.write_bytes(len(header).to_bytes(8, "little") + header + b"\0\0")
    assert "not a safetensors file" in refusal(path)


def test_the_other_kind(tmp_path):
    path = tmp_path / "a.safetensors"
    save(path, tensors(), METADATA, "snapshot")
    assert "is a 'snapshot', not a checkpoint" in refusal(path, "checkpoint")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": None}, "metadata kind is missing"),
        ({"format": None}, "metadata format is missing"),
        ({"digest": None}, "metadata digest is missing"),
        ({"format": "2"}, "has format '2': this version of railctl reads format 1"),
        ({"episode": "51"}, "damaged"),
        ({"extra": ""}, "damaged"),
    ],
)
def test_metadata_that_is_missing_or_changed(tmp_path, change, message):
    path = tmp_path / "a.safetensors"
    _, metadata = from_bytes(to_bytes(tensors(), METADATA, "snapshot"), "snapshot", "memory")
    changed = {name: value for name, value in {**metadata, **change}.items() if value is not None}
    safetensors.numpy.save_file(tensors(), path, changed)
    assert message in refusal(path)


def test_no_metadata_at_all(tmp_path):
    path = tmp_path / "a.safetensors"
    safetensors.numpy.save_file(tensors(), path)
    assert "metadata kind is missing" in refusal(path)


@pytest.mark.parametrize(
    "change",
    [
        {"flags": np.array([True, True])},
        {"flags": np.array([1, 0], np.uint8)},
        {"network/q.weight": np.arange(6, dtype=np.float32).reshape(3, 2)},
    ],
)
def test_a_changed_value_dtype_or_shape(tmp_path, change):
    path = tmp_path / "a.safetensors"
    _, metadata = from_bytes(to_bytes(tensors(), METADATA, "snapshot"), "snapshot", "memory")
    safetensors.numpy.save_file(tensors() | change, path, metadata)
    assert "damaged" in refusal(path)


DATA = to_bytes(tensors(), METADATA, "snapshot")


@fuzz
@cases(400)
@given(st.integers(0, len(DATA) - 1), st.integers(1, 255))
def test_a_flipped_byte_is_never_silently_wrong(position, flip):
    damaged = bytearray(DATA)
    damaged[position] ^= flip
    try:
        loaded, metadata = from_bytes(bytes(damaged), "snapshot", "memory")
    except CheckpointError as error:
        assert "\n" not in str(error)  # noqa: PT017  (either way is right)
    else:  # blank space in the header
        assert_same(tensors(), loaded)
        assert METADATA.items() <= metadata.items()


@fuzz
@cases(100)
@given(st.integers(0, len(DATA) - 1))
def test_a_truncated_file_is_refused(length):
    with pytest.raises(CheckpointError):
        from_bytes(DATA[:length], "snapshot", "memory")


def test_needs_no_torch():
    code = "import sys, railctl.common.checkpoint; sys.exit('torch' in sys.modules)"
    assert subprocess.run([*PYTHON, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_weights_that_are_not_finite_are_no_checkpoint(tmp_path, number):
    path = tmp_path / "a.safetensors"
    weights = {"q.weight": np.array([1, number], np.float32)}
    save(path, weights, METADATA, "checkpoint")
    said = refusal(path, "checkpoint")
    assert said.endswith("tensor q.weight has numbers that are not finite: use another checkpoint")
    save(path, weights, METADATA, "snapshot")
    assert_same(weights, load(path, "snapshot")[0])


@pytest.mark.parametrize("dtype", ["f8", "f2", "i1", "?"])
def test_weights_of_another_dtype_are_no_checkpoint(tmp_path, dtype):
    path = tmp_path / "a.safetensors"
    weights = {"q.bias": np.zeros(1, np.float32), "q.weight": np.ones(2, dtype)}
    save(path, weights, METADATA, "checkpoint")
    said = refusal(path, "checkpoint")
    assert said.endswith(f"tensor q.weight has dtype {weights['q.weight'].dtype}, not float32: use another one")
    save(path, weights, METADATA, "snapshot")
    assert_same(weights, load(path, "snapshot")[0])


def test_of_a_huge_file_of_another_kind_the_beginning_is_enough(tmp_path):
    path = tmp_path / "a.safetensors"
    with path.open("wb") as file:
        file.truncate(1 << 42)
    assert "not a safetensors file" in refusal(path)


def test_a_checkpoint_that_is_larger_than_any_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "a.safetensors"
    save(path, tensors(), METADATA, "checkpoint")
    monkeypatch.setitem(checkpoint.MOST_BYTES, "checkpoint", 100)
    assert "cannot be read (larger than 0.0001 MB)" in refusal(path, "checkpoint")
