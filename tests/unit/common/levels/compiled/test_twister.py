"""Draws in compiled code are those of numpy's RandomState."""

import numpy as np
import pytest
from flatland.utils.seeding import np_random
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.random import RandomState

from railctl.common.levels.compiled.twister import (
    draw_below,
    draw_pair,
    draw_uniform,
    draw_word,
    plainly_seeded,
    seed_by_words,
    seeded,
)


@settings(deadline=None)  # the first call compiles
@given(st.integers(min_value=0, max_value=2**70))
@example(0)
@example(2**32)
def test_seeds_are_the_library_s(seed: int):
    theirs = np_random(seed)[0].get_state()
    assert seeded(seed).tolist() == [*theirs[1].tolist(), theirs[2]]


@pytest.mark.parametrize("seed", [0, 12, 2**32 - 1])
def test_plain_seeds_are_numpy_s(seed: int):
    theirs = RandomState(seed).get_state()
    assert plainly_seeded(seed).tolist() == [*theirs[1].tolist(), theirs[2]]


def test_a_seed_of_one_word():
    state = plainly_seeded(1)
    seed_by_words(state, 77, 0)
    assert state[:-1].tolist() == RandomState([77]).get_state()[1].tolist()


def test_a_negative_seed_is_refused():
    with pytest.raises(ValueError, match="seed -1 is negative"):
        seeded(-1)


def test_draws_are_numpy_s_in_any_order():
    state, theirs = plainly_seeded(3), RandomState(3)
    choose = RandomState(4)
    for _ in range(2000):  # more than one turn of the twister
        kind, number = choose.randint(4), int(choose.choice([1, 2, 3, 4, 5, 7, 64, 65, 1000, 2**31, 2**32]))
        if kind == 0:
            assert draw_word(state) == theirs.randint(2**32)
        elif kind == 1:
            assert draw_below(state, number) == theirs.randint(number)
        elif kind == 2:
            assert draw_uniform(state) == theirs.random_sample()
        else:
            shuffled = np.zeros(2 + number % 30, np.int64)
            draw_pair(state, shuffled)
            assert shuffled[:2].tolist() == theirs.choice(len(shuffled), 2, replace=False).tolist()
    assert state[:-1].tolist() == theirs.get_state()[1].tolist()
