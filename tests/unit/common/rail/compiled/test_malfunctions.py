"""Malfunctions: the numbers of numpy's own generator."""

import numpy as np
import pytest
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen

from common.rail.compiled.malfunctions import DRAWS, Malfunctions, duration, generator_of, words_of


@pytest.mark.parametrize(("shortest", "longest"), [(2, 6), (1, 1), (0, 31), (20, 50), (5, 1000)])
def test_durations_are_numpys(shortest: int, longest: int):
    rng = np.random.RandomState(7)
    rng.rand(5)
    words = words_of(rng)
    expected = [rng.randint(shortest, longest + 1) + 1 for _ in range(2000)]  # past a renewal of the key
    assert [duration(words, shortest, longest) for _ in range(2000)] == expected
    assert generator_of(words).randint(1 << 30) == rng.randint(1 << 30)


def test_draws_are_flatlands():
    theirs, rng = ParamMalfunctionGen(MalfunctionParameters(1 / 10, 2, 6)), np.random.RandomState(1)
    ours = Malfunctions.drawn(1 / 10, 2, 6, np.random.RandomState(1))
    words = ours.twister.copy()
    broken = np.unpackbits(ours.broken)
    for draw in range(1, 3000):
        malfunction = theirs.generate(rng)
        assert (malfunction is not None) == broken[draw]
        if malfunction is not None:
            assert malfunction.num_broken_steps == duration(words, 2, 6)


def test_the_table_outlives_an_episode():
    first = Malfunctions.drawn(1 / 10, 2, 6, np.random.RandomState(1))
    second = first.continued(DRAWS - 1, np.random.RandomState(2))
    assert second.broken is first.broken
    assert second.draw == DRAWS - 1
    assert generator_of(second.twister).rand() == np.random.RandomState(2).rand()


def test_nothing_breaks_at_rate_nought():
    assert not Malfunctions.drawn(0, 2, 6, np.random.RandomState(1)).broken.any()
