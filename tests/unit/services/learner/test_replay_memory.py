"""The ring against a plain list, whatever is drawn from it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.rules.replay import PrioritizedReplay, UniformReplay
from railctl.services.learner.replay.replay import Items, Replay
from railctl.services.learner.sparse import dense_rows

F = 3
COLUMNS = {"action": np.int8, "reward": np.float32, "back": np.int32}
ROWS = ("before", "after")
KINDS = ("uniform", "prioritized")
REPLAYS = {"uniform": UniformReplay, "prioritized": PrioritizedReplay}


def make_replay(capacity, kind="uniform", **exponents):
    return Replay(REPLAYS[kind](capacity=capacity, **exponents), COLUMNS, ROWS, F)


def numbered(first, count):
    """Items whose every column tells their number."""
    number = np.arange(first, first + count)
    return {
        "action": (number % 5).astype(np.int8),
        "reward": -number.astype(np.float32),
        "back": (number % 3).astype(np.int32),
        "before": (np.repeat(number, F).reshape(count, F) * [1, 0, 2]).astype(np.float32),
        "after": np.repeat(number + 0.5, F).reshape(count, F).astype(np.float32),
    }


def naive_add(ring, added, capacity, numbers):
    """Put each number where the oldest lies; `added` counts all so far."""
    for i, number in enumerate(numbers, start=added):
        if len(ring) < capacity:
            ring.append(number)
        else:
            ring[i % capacity] = number


def through_state(replay, capacity, kind):
    other = make_replay(capacity, kind)
    other.add(numbered(500, 2 * capacity + 1))  # what was there before must not matter
    other.restore(replay.state())
    return other


def same(states):
    ours, theirs = states
    assert list(ours) == list(theirs)
    for name, array in ours.items():
        assert array.tobytes() == theirs[name].tobytes(), name


@settings(deadline=None)
@given(
    st.sampled_from(KINDS),
    st.integers(1, 9),
    st.lists(st.tuples(st.integers(0, 12), st.booleans()), max_size=12),
    st.integers(0, 2**32),
)
def test_the_ring_is_a_list_whose_oldest_give_way(kind, capacity, additions, seed):
    replay, ring, added = make_replay(capacity, kind), [], 0
    for count, restored in additions:
        replay.add(numbered(added, count))
        naive_add(ring, added, capacity, range(added, added + count))
        added += count
        if restored:
            replay = through_state(replay, capacity, kind)
        assert len(replay) == len(ring)
        assert (-replay.state()["reward"]).tolist() == ring
        if ring:
            sample = replay.sample(5, seed)
            expected = numbered(0, added)
            rows = {name: dense_rows(row) for name, row in sample.rows.items()}
            assert set(rows) == set(ROWS)
            for name, array in (sample.columns | rows).items():
                np.testing.assert_array_equal(array, expected[name][np.array(ring)[sample.places]])


def test_uniform_places_are_the_generators_own():
    replay = make_replay(10)
    replay.add(numbered(0, 7))
    sample = replay.sample(5, 3, beta=0.3)
    assert sample.places.tolist() == np.random.Generator(np.random.Philox(key=3)).integers(7, size=5).tolist()
    assert sample.weights.tolist() == [1] * 5
    places = sample.places.tolist()
    replay.reprioritise(sample.places, np.full(5, 9.0))
    assert replay.sample(5, 3).places.tolist() == places


@settings(deadline=None)
@given(
    st.sampled_from(KINDS),
    st.integers(1, 9),
    st.lists(st.tuples(st.integers(0, 12), st.floats(0, 100)), min_size=2, max_size=9),
    st.integers(1, 8),
)
def test_a_restored_replay_goes_on_with_the_same_bits(kind, capacity, steps, turn):
    straight = make_replay(capacity, kind)
    straight.add(numbered(0, 1))
    restored = None
    for i, (count, priority) in enumerate(steps):
        if i == turn:
            restored = through_state(straight, capacity, kind)
        told = []
        for replay in filter(None, (straight, restored)):
            replay.add(numbered(100 * i, count), np.linspace(0, priority, count) if i % 2 else None)
            sample = replay.sample(4, i, beta=0.4)
            told.append((sample.places.tolist(), sample.weights.tolist(), dense_rows(sample.rows["after"]).tolist()))
            replay.reprioritise(sample.places, np.array([priority, 0, 1, priority / 2]))
        assert told[0] == told[-1]
    if restored:
        same((straight.state(), restored.state()))
        assert straight.metrics() == restored.metrics()


def test_a_sample_uses_its_memory_again():
    replay = make_replay(10, "prioritized")
    replay.add(numbered(0, 10))
    first = replay.sample(4, 1)
    assert {name: array.dtype for name, array in first.columns.items()} == {
        "action": np.int64,
        "reward": np.float32,
        "back": np.int64,
    }
    assert first.rows["before"].shape == (4, F)
    second = replay.sample(4, 2)
    assert second is first
    assert replay.sample(6, 2).columns["reward"].shape == (6,)


def test_sampling_is_uniform():
    replay = make_replay(4)
    replay.add(numbered(0, 6))
    sample = replay.sample(8000, 1)
    numbers, counts = np.unique(sample.columns["reward"], return_counts=True)
    assert sorted(-numbers) == [2, 3, 4, 5]
    assert (abs(counts - 2000) < 200).all()  # five standard deviations


def test_priorities_by_hand():
    replay = make_replay(4, "prioritized", alpha=1.0)
    replay.add(numbered(0, 2))  # at 1, the largest so far
    replay.add(numbered(2, 1), np.array([6.0]))
    assert replay.metrics() == pytest.approx({"replay_fill": 0.75, "priority_mean": 8 / 3, "priority_max": 6})
    sample = replay.sample(8, 1, beta=0.5)
    assert sample.places.tolist() == [0, 1, 2, 2, 2, 2, 2, 2]
    assert sample.weights.tolist() == pytest.approx([1, 1, *[6**-0.5] * 6])
    replay.reprioritise(np.array([2, 0]), np.array([1.0, 2.0]))
    replay.add(numbered(3, 2))  # at 6, the second of them in the place of the first item
    assert replay.state()["priorities"].tolist() == pytest.approx([6, 1, 1, 6])
    assert make_replay(4).metrics() == {"replay_fill": 0}


def test_of_more_items_than_there_is_room_for_the_last_stay_with_their_priorities():
    replay = make_replay(3, "prioritized", alpha=1.0)
    replay.add(numbered(0, 5), np.array([9.0, 9, 1, 2, 3]))
    state = replay.state()
    assert state["reward"].tolist() == [-3, -4, -2]
    assert state["priorities"].tolist() == pytest.approx([2, 3, 1])
    assert state["priority_maximum"] == 3  # of those that were ever here


def test_histories_by_hand():
    replay = make_replay(5)
    items = numbered(1, 6)  # trains 1 3 5 6 and 2 4
    items["back"] = np.array([0, 0, 2, 2, 2, 1])
    replay.add({name: array[:5] for name, array in items.items()})
    histories = dense_rows(replay.histories(np.array([4, 3, 1]), 3))
    assert histories[:, :, 0].tolist() == [[1, 0, 0], [3, 2, 0], [5, 4, 2]]
    assert histories.shape == (3, 3, F)
    replay.add({name: array[5:] for name, array in items.items()})  # over the first
    assert dense_rows(replay.histories(np.array([4, 0]), 4))[:, :, 0].tolist() == [[0, 0], [0, 3], [3, 5], [5, 6]]
    replay = through_state(replay, 5, "uniform")
    assert dense_rows(replay.histories(np.array([4, 0]), 4))[:, :, 0].tolist() == [[0, 0], [0, 3], [3, 5], [5, 6]]


@settings(deadline=None)
@given(st.integers(1, 7), st.lists(st.integers(0, 2), max_size=20), st.integers(1, 5))
def test_histories_are_those_of_lists(capacity, trains, length):
    replay, seen, histories = make_replay(capacity), {}, []
    for number, train in enumerate(trains):
        earlier = seen.setdefault(train, [])
        back = number - earlier[-1] if earlier else 0
        earlier.append(number)
        histories.append(list(earlier))
        replay.add(numbered(number, 1) | {"back": np.array([back])})
    kept = range(max(0, len(trains) - capacity), len(trains))
    got = dense_rows(replay.histories(np.array([number % capacity for number in kept], np.int64), length))
    rows = numbered(0, len(trains))["before"]
    for i, number in enumerate(kept):
        alive = [rows[one] for one in histories[number] if one in kept][-length:]
        padding = [np.zeros(F)] * (length - len(alive))
        np.testing.assert_array_equal(got[:, i], np.array([*padding, *alive]))


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_come_back_to_the_bit_and_with_their_sign(kind):
    columns = {"small": np.int8, "middle": np.int16, "large": np.int32, "real": np.float32}
    replay = Replay(REPLAYS[kind](capacity=2), columns, ("row",), F)
    items = {name: np.array([np.iinfo(dtype).min, -1], dtype) for name, dtype in columns.items() if name != "real"}
    items["real"] = np.array([0x7FC00123, 0x80000000], np.uint32).view(np.float32)  # a NaN, -0
    replay.add(items | {"row": np.ones((2, F), np.float32)})
    sample = replay.sample(16, 1)
    for name, array in items.items():
        assert replay.state()[name].tobytes() == array.tobytes()
        expected = array[sample.places].astype(np.float32 if name == "real" else np.int64)
        assert sample.columns[name].tobytes() == expected.tobytes()


def test_items_may_come_packed_and_in_parts():
    columns = {"back": np.int32, "small": np.int8, "real": np.float32}
    named, packed = (Replay(UniformReplay(capacity=5), columns, ROWS, F) for _ in range(2))
    rng = np.random.default_rng(1)
    numbers, rows = np.zeros((8, 3), np.uint32), (rng.random((8, 2, F)) * [0, 1, 1]).astype(np.float32)
    numbers.view(np.int32)[:, :2] = rng.integers(-128, 128, (8, 2))
    numbers.view(np.float32)[:, 2] = rng.random(8)
    items = Items(numbers, rows.view(np.uint32))
    for begin, end in ((0, 0), (0, 2), (2, 8)):
        packed.append(items.part(begin, end))
        part = slice(begin, end)
        by_name = {"small": numbers.view(np.int32)[part, 1], "back": numbers.view(np.int32)[part, 0]}
        by_name |= {"real": numbers.view(np.float32)[part, 2], "before": rows[part, 0], "after": rows[part, 1]}
        named.add(by_name)
        same((packed.state(), named.state()))


def test_columns_of_more_than_32_bits_are_refused():
    with pytest.raises(ValueError, match=r"columns are of uint8, int8, int16, int32, float32, not \{'time': 'int64'\}"):
        Replay(UniformReplay(capacity=4), {"time": np.int64}, ROWS, F)


@pytest.mark.parametrize("kind", KINDS)
def test_an_empty_ring_cannot_be_sampled(kind):
    with pytest.raises(ValueError, match="empty replay"):
        make_replay(4, kind).sample(1, 1)


def test_items_that_do_not_fit_are_refused():
    replay, items = make_replay(4), numbered(0, 2)
    with pytest.raises(ValueError, match="items need"):
        replay.add({name: items[name] for name in items if name != "back"})
    with pytest.raises(ValueError, match="items differ in number"):
        replay.add(items | {"back": np.zeros(3)})
    with pytest.raises(ValueError, match="rows have 3 values"):
        replay.add(items | {"after": np.zeros((2, 4), np.float32)})
    assert len(replay) == 0


def test_a_state_is_a_copy_of_the_filled_part():
    replay = make_replay(10, "prioritized")
    replay.add(numbered(1, 3))
    state = replay.state()
    assert {name: len(array) for name, array in state.items() if array.ndim} == {
        "action": 3,
        "reward": 3,
        "back": 3,
        "rows": 3 * (1 + 2 + 1) + 3 * (1 + 3 + 1),
        "priorities": 3,
    }
    replay.add(numbered(4, 9))
    assert state["reward"].tolist() == [-1, -2, -3]
    assert state["priorities"].tolist() == pytest.approx([1, 1, 1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cursor": None}, "tensor cursor is missing"),
        ({"extra": np.zeros(3)}, "tensor extra is unknown"),
        ({"cursor": np.array(1)}, "cursor 1 does not fit 3 items"),
        ({"reward": np.zeros(2, np.float32)}, "reward is float32"),
        ({"reward": np.zeros(3)}, "reward is float64"),
        ({"rows": np.zeros(3)}, "rows is float64"),
        ({"rows": np.zeros((6, 1), np.uint32)}, "rows is uint32"),
        ({"rows": np.zeros(5, np.uint32)}, "rows: 5 words are not 3 times 2 rows of 3"),
        ({"action": np.zeros(5, np.int8)}, "holds 5 items, the capacity is 4"),
        ({"priorities": np.ones(4)}, "priorities is float64"),
        ({"priorities": np.array([1, 0, 1.0])}, "priorities is not above 0 and finite"),
        ({"priority_maximum": np.array(np.inf)}, "priority_maximum is not above 0 and finite"),
    ],
)
def test_a_state_that_does_not_fit_is_refused(change, message):
    replay = make_replay(4, "prioritized")
    replay.add(numbered(0, 3))
    state = {name: array for name, array in (replay.state() | change).items() if array is not None}
    fresh = make_replay(4, "prioritized")
    with pytest.raises(ValueError, match=message):
        fresh.restore(state)
    assert len(fresh) == 0
