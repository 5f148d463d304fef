"""Rows without their zeros against plain ones, bit for bit."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.services.learner.replay.rows import RowRing

BITS = (0, 1, 0x80000000, 0x7FC00001, 0xFF800000, 0xBF000000)  # 0, the least above it, -0, a NaN, -inf, -0.5


def random_items(rng, count, n_rows, n_features):
    """[count, n_rows, F] bits, from empty rows to some without a zero."""
    shape = (count, n_rows, n_features)
    kept = rng.random(shape) < rng.choice([0, 0.1, 0.5, 1], size=(count, n_rows, 1))
    return np.where(kept, rng.choice(np.array(BITS, np.uint32), size=shape), np.uint32(0))


def check_places(ring, naive, n_rows, n_features):
    places = np.array([-1, *naive, *naive], np.int64)
    for wanted in range(1, n_rows + 1):
        out = ring.room_for(len(places), wanted)
        ring.gather(places, out)
        for row, (starts, columns, values) in enumerate(zip(*out, strict=True)):
            got = np.zeros((len(places), n_features), np.uint32)
            got[np.repeat(np.arange(len(places)), np.diff(starts)), columns[: starts[-1]]] = values[: starts[-1]]
            expected = [np.zeros(n_features), *(naive[place][row] for place in places[1:].tolist())]
            np.testing.assert_array_equal(got, np.array(expected))
            assert all((np.diff(columns[a:b]) > 0).all() for a, b in itertools.pairwise(starts))


@settings(deadline=None, max_examples=200)
@given(
    st.integers(1, 7),
    st.integers(1, 3),
    st.sampled_from([1, 2, 5, 255, 256]),  # positions of one byte, and of two
    st.lists(st.tuples(st.integers(0, 7), st.booleans()), max_size=12),
    st.integers(0, 2**32),
)
def test_every_row_comes_back_to_the_bit(capacity, n_rows, n_features, additions, seed):
    ring, naive, added = RowRing(capacity, n_rows, n_features), {}, 0
    rng = np.random.default_rng(seed)
    for count, through_state in additions:
        items = random_items(rng, min(count, capacity), n_rows, n_features)
        ring.add(items, added)
        for item in range(min(count, capacity)):
            naive[(added + item) % capacity] = items[item]
        added += min(count, capacity)
        if through_state and naive:
            words, ring = ring.state(len(naive)), RowRing(capacity, n_rows, n_features)
            oldest = added % capacity if added > capacity else 0
            ring.restore(words, ring.located(words, len(naive)), oldest)
            np.testing.assert_array_equal(ring.state(len(naive)), words)
        check_places(ring, naive, n_rows, n_features)


def test_positions_take_as_many_bytes_as_they_need():
    for n_features, words in [(255, 1 + 3 + 1), (256, 1 + 3 + 2), (70_000, 1 + 3 + 3)]:
        ring = RowRing(2, 1, n_features)
        row = np.zeros((1, n_features), np.uint32)
        row[0, [0, 1, -1]] = 7
        ring.add(row[None], 0)
        assert len(ring.state(1)) == words
        check_places(ring, {0: [row[0]]}, 1, n_features)


def test_a_state_by_hand():
    ring = RowRing(2, 2, 6)
    ring.add(np.array([[[0, 8, 9, 0, 0, 7], [0] * 6]], np.uint32), 0)
    assert ring.state(1).tolist() == [3, 8, 9, 7, 1 + 2 * 2**8 + 5 * 2**16, 0]


def test_the_arena_stops_growing_once_the_ring_is_full():
    ring, rng = RowRing(50, 1, 40), np.random.default_rng(1)
    sizes = []
    for first in range(0, 1000, 10):
        lengths = np.arange(10)[:, None] + rng.permutation(10)[0]
        ring.add((np.arange(40) < lengths % 11).astype(np.uint32)[:, None], first)
        sizes.append(ring.nbytes)
    assert sizes[-1] == sizes[10]
    assert sizes[-1] < 2 * ring.state(50).nbytes + 50 * 16


def test_rows_of_another_length_are_refused():
    for shape in ((2, 1, 5), (2, 2, 4)):
        with pytest.raises(ValueError, match="1 rows have 4 values each here"):
            RowRing(3, 1, 4).add(np.zeros(shape, np.uint32), 0)


@pytest.mark.parametrize(
    "words",
    [[], [0], [1, 9], [5, 9, 9, 9, 9, 9, 0, 0], [1, 9, 4], [1, 9, 3, 0], [1, 9, 3, 0, 0], [2**32 - 1, 9, 3]],
)
def test_words_that_are_not_two_items_are_refused(words):
    ring = RowRing(3, 1, 4)
    if words == [1, 9, 3, 0]:
        assert ring.located(np.array(words, np.uint32), 2).tolist() == [3, 4]
    else:
        with pytest.raises(ValueError, match="words are not 2 times 1 rows of 4"):
            ring.located(np.array(words, np.uint32), 2)
