"""The ring against a plain list."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from services.learner.replay.transitions import Transitions
from services.learner.replay.uniform import FIELDS, UniformReplay

F = 3


def numbered(first, count):
    """Transitions whose every field tells their number."""
    number = np.arange(first, first + count)
    return Transitions(
        observation_tm1=np.repeat(number, F).reshape(count, F).astype(np.float32),
        action_tm1=(number % 5).astype(np.int8),
        reward_t=-number.astype(np.float32),
        discount_t=number.astype(np.float32) / 1000,
        observation_t=np.repeat(number + 0.5, F).reshape(count, F).astype(np.float32),
        completed_at=number.astype(np.int64),
    )


def naive_add(ring, added, capacity, numbers):
    """Put each number where the oldest lies; `added` counts all so far."""
    for i, number in enumerate(numbers, start=added):
        if len(ring) < capacity:
            ring.append(number)
        else:
            ring[i % capacity] = number


@settings(deadline=None)
@given(
    st.integers(1, 9),
    st.lists(st.tuples(st.integers(0, 12), st.booleans()), max_size=12),
    st.integers(0, 2**32),
)
def test_the_ring_is_a_list_whose_oldest_give_way(capacity, additions, seed):
    replay, ring, added = UniformReplay(capacity, F), [], 0
    for count, through_state in additions:
        replay.add(numbered(added, count))
        naive_add(ring, added, capacity, range(added, added + count))
        added += count
        if through_state:
            state, replay = replay.state(), UniformReplay(capacity, F)
            replay.restore(state)
        assert len(replay) == len(ring)
        assert (-replay.state()["reward_t"]).tolist() == ring
        if ring:
            batch = replay.sample(5, np.random.default_rng(seed))
            chosen = np.array(ring)[np.random.default_rng(seed).integers(len(ring), size=5)]
            expected = numbered(0, added)
            for name in FIELDS:
                np.testing.assert_array_equal(getattr(batch, name).numpy(), getattr(expected, name)[chosen])


def test_a_batch_has_the_dtypes_of_training_and_reuses_its_memory():
    replay = UniformReplay(10, F)
    replay.add(numbered(0, 10))
    first = replay.sample(4, np.random.default_rng(1))
    assert first.action_tm1.dtype == torch.int64
    assert {getattr(first, name).dtype for name in FIELDS if name != "action_tm1"} == {torch.float32}
    assert first.observation_tm1.shape == (4, F)
    assert replay.sample(4, np.random.default_rng(2)) is first
    assert replay.sample(6, np.random.default_rng(2)).reward_t.shape == (6,)


def test_sampling_is_uniform():
    replay = UniformReplay(4, F)
    replay.add(numbered(0, 6))
    batch = replay.sample(8000, np.random.default_rng(1))
    numbers, counts = np.unique(batch.reward_t.numpy(), return_counts=True)
    assert sorted(-numbers) == [2, 3, 4, 5]
    assert (abs(counts - 2000) < 200).all()  # five standard deviations


def test_an_empty_ring_cannot_be_sampled():
    with pytest.raises(ValueError, match="empty replay"):
        UniformReplay(4, F).sample(1, np.random.default_rng(1))


def test_a_state_is_a_copy_of_the_filled_part():
    replay = UniformReplay(10, F)
    replay.add(numbered(1, 3))
    state = replay.state()
    assert state["observation_tm1"].shape == (3, F)
    replay.add(numbered(4, 9))
    assert state["reward_t"].tolist() == [-1, -2, -3]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cursor": None}, "tensor cursor is missing"),
        ({"extra": np.zeros(3)}, "tensor extra is unknown"),
        ({"cursor": np.array(1)}, "cursor 1 does not fit 3 transitions"),
        ({"reward_t": np.zeros(2, np.float32)}, "reward_t is float32"),
        ({"reward_t": np.zeros(3)}, "reward_t is float64"),
        ({"observation_t": np.zeros((3, F + 1), np.float32)}, "observation_t is float32"),
        ({"action_tm1": np.zeros(5, np.int8)}, "holds 5 transitions, the capacity is 4"),
    ],
)
def test_a_state_that_does_not_fit_is_refused(change, message):
    replay = UniformReplay(4, F)
    replay.add(numbered(0, 3))
    state = {name: array for name, array in (replay.state() | change).items() if array is not None}
    fresh = UniformReplay(4, F)
    with pytest.raises(ValueError, match=message):
        fresh.restore(state)
    assert len(fresh) == 0
