"""Weights come off a board as they were put there, or not at all."""

import os
import resource
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railctl.common.board import Board, BoardReader, Slots, look_over
from railctl.common.policy.flat import Flat, Order
from railctl.common.policy.packing import KINDS, Layout

SHAPES = {"first.weight": (3, 2), "first.bias": (3,), "scale": ()}
COUNT = 3


def tensors(version):
    rng = np.random.default_rng(version)
    return {name: rng.standard_normal(shape).astype(np.float32) for name, shape in SHAPES.items()}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "weights.board"


@pytest.fixture
def board(path):
    board = Board(path, tensors(0), COUNT)
    yield board
    board.close()


@pytest.fixture
def reader(path):
    reader = BoardReader(path)
    yield reader
    reader.close()


def has(reader, version):
    taken = reader.get(version)
    if taken is None:
        return False
    for name, array in tensors(version).items():
        assert taken[name].dtype == np.float32
        assert taken[name].shape == array.shape
        assert taken[name].tobytes() == array.tobytes()
    return taken.keys() == tensors(version).keys()


def test_the_last_versions_are_there_and_the_others_are_not(board, reader):
    assert not any(has(reader, version) for version in range(COUNT + 1))
    for version in range(7):
        board.put(version, tensors(version))
        assert [v for v in range(10) if has(reader, v)] == list(range(max(0, version - COUNT + 1), version + 1))


def test_what_is_taken_is_the_readers_own(board, reader):
    board.put(1, tensors(1))
    taken = reader.get(1)
    board.put(1 + COUNT, tensors(1 + COUNT))
    assert taken["first.weight"].tobytes() == tensors(1)["first.weight"].tobytes()
    taken["first.weight"][:] = 0
    assert has(reader, 1 + COUNT)


def test_tensors_in_any_layout_are_put(board, reader):
    turned = tensors(4) | {"first.weight": np.asfortranarray(tensors(4)["first.weight"])}
    board.put(4, turned)
    assert has(reader, 4)


def test_what_is_taken_stays_until_the_call_after_the_next_that_finds_some(board, reader):
    for version in range(COUNT):
        board.put(version, tensors(version))
    taken = reader.get(0)
    assert reader.get(9) is None
    assert reader.get(1) is not None
    assert reader.get(9) is None
    assert taken["first.weight"].tobytes() == tensors(0)["first.weight"].tobytes()
    assert reader.get(2) is not None
    assert taken["first.weight"].tobytes() == tensors(2)["first.weight"].tobytes()


@pytest.mark.parametrize("like", ["in order", "by name"])
@pytest.mark.parametrize("kind", KINDS)
def test_weights_in_an_order_of_their_own_arrive_in_it(path, reader, like, kind):
    order = Layout(kind, 7, 5, (9, 6)).order
    rng = np.random.default_rng(1)
    by_name = {name: rng.standard_normal(place.shape).astype(np.float32) for name, place in order.places.items()}
    flat = order.pack(by_name)
    board = Board(path, Flat(order, flat), COUNT)
    board.put(0, Flat(order, flat) if like == "in order" else by_name)
    taken = reader.get(0)
    assert order.pack(taken) is taken.flat
    assert taken.flat.tobytes() == flat.tobytes()
    for name, array in by_name.items():
        np.testing.assert_array_equal(taken[name], array)
    board.close()


def test_weights_in_an_order_of_their_own_are_put_on_a_board_of_another(board, reader):
    places = Order.of(tensors(1)).places
    moved = Order(12, {name: place._replace(begin=place.begin + 4) for name, place in places.items()})
    board.put(1, Flat(moved, moved.pack(tensors(1))))
    assert has(reader, 1)


@pytest.mark.parametrize("number", [np.inf, -np.inf, np.nan, -np.nan])
def test_numbers_that_are_not_finite_are_refused(board, reader, number):
    for name, array in tensors(1).items():
        with pytest.raises(ValueError, match="weights 1 have numbers that are not finite"):
            board.put(1, tensors(1) | {name: np.full_like(array, number)})
    assert reader.get(1) is None


@given(st.lists(st.floats(width=32), min_size=1, max_size=6))
def test_numbers_are_looked_over_by_their_bits(numbers):
    flat = np.array([*numbers, *numbers], np.float32)
    assert look_over(flat.view(np.int64)) == (flat.view(np.int64).sum(), np.isfinite(flat).all())


def test_without_a_board_nothing_is_there_until_one_comes(path, reader):
    assert reader.get(0) is None
    board = Board(path, tensors(0), COUNT)
    board.put(0, tensors(0))
    assert has(reader, 0)
    board.close()
    assert reader.get(0) is None
    assert not path.exists()


def test_a_new_learners_board_hides_all_that_an_earlier_one_left(path, reader):
    Board(path, tensors(0), COUNT).put(5, tensors(5))  # and then it was killed
    assert has(reader, 5)
    board = Board(path, tensors(0), COUNT)
    assert reader.get(5) is None
    board.put(2, tensors(2))
    assert has(reader, 2)
    board.close()


def test_a_slot_that_is_not_whole_is_not_there(board, path, reader):
    slots = Slots(Order.of_shapes(SHAPES), COUNT)
    start, length = slots.start(1), slots.slot_bytes
    board.put(1, tensors(1))
    good = path.read_bytes()
    board.put(1 + COUNT, tensors(1 + COUNT))
    newer = path.read_bytes()
    for cut in range(1, length):  # a writer that was killed, or is at work
        torn = newer[: start + cut] + good[start + cut :]
        with path.open("r+b") as file:
            file.write(torn)
        assert torn in (good, newer) or (reader.get(1), reader.get(1 + COUNT)) == (None, None)
    for at in range(start, start + length):  # whatever else may happen to it
        with path.open("r+b") as file:
            file.write(good[:at] + bytes([good[at] ^ 0x40]) + good[at + 1 :])
        assert reader.get(1) is None


@pytest.mark.parametrize(
    "damage",
    [
        lambda _good: b"",
        lambda good: good[:-1],
        lambda good: b"\xff" * len(good),
        lambda good: (2).to_bytes(8, "little") + b"{}" + good[10:],
        lambda good: (2).to_bytes(8, "little") + b"[]" + good[10:],
        lambda good: good.replace(b'"count": 3', b'"count": 0'),
        lambda good: good.replace(b"[3, 2]", b"[3000, 2000]"),
        lambda good: good.replace(b"[[3, 2], 0", b"[[9, 2], 0"),
        lambda good: good.replace(b"[[3, 2], 0, [4", b'[[3, 2], 0, "4'),
    ],
)
def test_what_is_no_board_has_nothing(path, reader, damage):
    board = Board(path, tensors(0), COUNT)
    board.put(0, tensors(0))
    good = path.read_bytes()
    board.close()
    path.write_bytes(good)
    assert has(reader, 0)
    path.unlink()
    path.write_bytes(damage(good))
    reader.close()
    assert reader.get(0) is None


def test_what_fits_in_part_is_an_error_that_says_why(path, reader):
    board = Board(path, {"w": np.zeros(100_000, np.float32)}, 1)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, before[1]))  # within the slot
    try:
        with pytest.raises(OSError, match="File too large"):
            board.put(7, {"w": np.ones(100_000, np.float32)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert reader.get(7) is None
    board.close()


def test_a_full_disk_is_an_error_and_no_torn_board(path, monkeypatch):
    def full(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space left"):
        Board(path, tensors(0), COUNT)
    assert not path.exists()


def test_readers_beside_a_writer_see_whole_versions_only(tmp_path):
    def filled(version):
        return {"w": np.full(100_000, version, np.float32)}

    path, last = tmp_path / "weights.board", 150
    board = Board(path, filled(0), 1)
    seen, newest = set(), 0

    def write():
        nonlocal newest
        for version in range(last + 1):
            newest = version
            board.put(version, filled(version))

    reader, writer = BoardReader(path), threading.Thread(target=write)
    writer.start()
    while last not in seen:
        version = newest
        if (taken := reader.get(version)) is not None:
            assert (taken["w"] == version).all()
            seen.add(version)
    writer.join()
    reader.close()
    board.close()
