"""Draws in compiled code against numpy's own."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.services.learner.replay.philox import draw_below, draw_uniform

KEYS = st.integers(0, 2**64 - 1)
LIMITS = st.integers(1, 2**32 - 1) | st.sampled_from([1, 2, 50_000, 2**31 + 1, 2**32 - 2, 2**32 - 1])


@settings(deadline=None)
@given(KEYS, LIMITS, st.integers(0, 50))
def test_whole_numbers_are_numpys(key, limit, count):
    drawn = np.empty(count, np.int64)
    draw_below(np.uint64(key), limit, drawn)
    np.testing.assert_array_equal(drawn, np.random.Generator(np.random.Philox(key=key)).integers(limit, size=count))


@settings(deadline=None)
@given(KEYS, st.integers(0, 50))
def test_doubles_are_numpys(key, count):
    drawn = np.empty(count)
    draw_uniform(np.uint64(key), drawn)
    np.testing.assert_array_equal(drawn, np.random.Generator(np.random.Philox(key=key)).random(count))
