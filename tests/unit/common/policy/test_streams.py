"""Compiled streams are those of `common.seeding`, bit for bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common import seeding
from railctl.common.policy import streams

WORDS = st.integers(0, 2**64 - 1)
COUNTERS = st.integers(0, 2**40)


@settings(max_examples=300, deadline=None)
@given(WORDS, COUNTERS)
def test_draws_are_those_of_seeding(key: int, counter: int):
    assert int(streams.bits(np.uint64(key), np.uint64(counter))) == seeding.bits(key, counter)
    assert streams.uniform(np.uint64(key), np.uint64(counter)) == seeding.uniform(key, counter)


@pytest.mark.parametrize("key", [0, 1, 2**63, 2**64 - 1])
def test_plain_python_gives_the_same_draws(key: int):
    with np.errstate(over="ignore"):  # it wraps around, as it shall
        for counter in range(20):
            expected = streams.bits(np.uint64(key), np.uint64(counter))
            assert streams.bits.py_func(np.uint64(key), np.uint64(counter)) == expected


def test_normals_are_normal():
    sample = np.empty(100_001)
    streams.normals(np.uint64(5), sample)
    assert abs(sample.mean()) < 0.015
    assert abs(sample.std() - 1) < 0.01
    assert abs((sample**3).mean()) < 0.05
    assert abs((sample**4).mean() - 3) < 0.1
    assert abs(np.corrcoef(sample[:-1], sample[1:])[0, 1]) < 0.015


def test_normals_of_a_key_are_a_prefix_of_each_other():
    short, long = np.empty(7), np.empty(100)
    streams.normals(np.uint64(9), short)
    streams.normals(np.uint64(9), long)
    np.testing.assert_array_equal(short, long[:7])
