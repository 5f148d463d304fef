"""Which runs the benchmark of clusters makes."""

import argparse

import pytest

from railctl.tools.bench.cluster import KINDS, kinds_of, lag_of, number_of


@pytest.mark.parametrize(
    ("lags", "actors", "kinds"),
    [
        (None, None, KINDS),
        (["free"], None, [("free", 2)]),
        (None, [1], [("0", 1), ("3", 1), ("free", 1)]),
        (["3", "free"], [1, 2], [("3", 1), ("3", 2), ("free", 1), ("free", 2)]),
    ],
)
def test_every_lag_is_run_with_every_number_of_actors(lags, actors, kinds):
    assert kinds_of(lags, actors) == kinds


@pytest.mark.parametrize("text", ["3.5", "-1", "1025", "fre", ""])
def test_what_is_no_lag_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match="is no lag: give a whole number from 0 to 1024, or free"):
        lag_of(text)


@pytest.mark.parametrize("text", ["-1", "257", "two"])
def test_what_is_no_number_of_actors_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match="is not a number from 0 to 256"):
        number_of(text)
