"""Long columns made short: every value counts somewhere, and hand-worked windows."""

import numpy as np
import pytest

from railctl.deploy.web.thinning import FEWEST, POINTS, block_size, blocks, moving, sample


def numbers(*values):
    return np.array(values, np.float32)


def test_a_window_that_is_full_holds_the_last_values():
    points = moving(numbers(*range(10)), window=5)
    assert points[-1] == (10, 7.0, 6.0, 8.0, 7.0)  # of 5 6 7 8 9
    assert points[0] == (5, 2.0, 1.0, 3.0, 2.0)


def test_a_window_grows_until_it_is_full():
    values = numbers(0, 0, 0, 0, 0, 10)
    assert moving(values, window=100)[-1] == (6, 0.0, 0.0, 0.0, pytest.approx(10 / 6, abs=1e-4))


@pytest.mark.parametrize("count", range(FEWEST))
def test_few_values_make_no_curve(count):
    assert moving(numbers(*range(count)), window=5) == []


def test_of_a_long_run_no_value_is_left_out():
    values = np.zeros(100_000, np.float32)
    values[54_321] = 1_000_000
    points = moving(values, window=10)
    assert len(points) == POINTS
    assert points[-1][0] == 100_000
    assert max(mean for *_, mean in points) > 1000


def test_a_sample_says_of_how_many_each_is_one():
    dots, every = sample([3, 4, 5, 6, 7], numbers(0.3, 0.4, 0.5, 0.6, 0.7), most=3)
    assert (every, [place for place, _ in dots]) == (2, [3, 5, 7])
    assert sample([1], numbers(0.5), most=3) == ([(1, 0.5)], 1)


def test_blocks_are_whole():
    assert blocks(numbers(1, 3, 5, 7, 100), size=2) == [2.0, 6.0]
    assert blocks(numbers(), size=2) == []


@pytest.mark.parametrize("total", [0, 1, 59, 60, 61, 119, 1500, 99_999, 10_000_000])
def test_there_are_at_most_so_many_blocks(total):
    assert total <= 60 * block_size(total, 60)
