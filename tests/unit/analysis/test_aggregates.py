"""Aggregates, comparisons and ranks: against rliable 1.2.0, worked by hand, and what holds of any scores.

`data/main_rliable.json` is what rliable says of synthetic scores, with numpy's global generator seeded by 0 before each
call. With that generator's draws our intervals are its own.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from railctl.analysis import aggregates as ours

DATA = Path(__file__).parent / "data"
RLIABLE = json.loads((DATA / "main_rliable.json").read_text())
SUMS = np.array(json.loads((DATA / "main_final_block.json").read_text())["sums"])  # [A, K, R]
SCORES = {f"alg{index}": of_one.T / (100 * 8192) for index, of_one in enumerate(SUMS)}
ORDER = ["iqm", "mean", "median", "optimality_gap"]

scores = arrays(np.float64, st.tuples(st.integers(2, 4), st.just(2)), elements=st.sampled_from([-1, -0.5, -0.25, -0.1]))


class Legacy:
    """Draws as rliable does: one sample after the other from numpy's global generator, of pairs in turn."""

    def __init__(self, per_sample: int) -> None:
        self._per_sample = per_sample
        self._drawn = np.empty(0)

    def __call__(self, values, reps, purpose="runs"):
        if purpose == "runs":
            np.random.seed(0)  # noqa: NPY002  (as the tool does)
            draws = [np.random.choice(len(values), values.shape) for _ in range(reps * self._per_sample)]  # noqa: NPY002
            self._drawn = np.reshape(draws, (reps, self._per_sample, *values.shape))
        return self._drawn[:, self._per_sample - 1 if purpose == "opponents" else 0]


def test_aggregates_are_those_of_rliable(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(ours, "_rows", Legacy(1))
        legacy = ours.aggregates(SCORES)
    own = ours.aggregates(SCORES)
    for name, theirs in RLIABLE["agg"].items():
        for figure, *expected in zip(ORDER, theirs["point"], theirs["ci_lo"], theirs["ci_hi"], strict=True):
            assert legacy[name][figure] == pytest.approx(expected, abs=1e-9)
            value, low, high = expected
            assert own[name][figure] == pytest.approx([value, low, high], abs=0.1 * (high - low))


def test_probabilities_of_improvement_are_those_of_rliable(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(ours, "_rows", Legacy(2))
        legacy = ours.probability_of_improvement(SCORES)
    own = ours.probability_of_improvement(SCORES)
    for i, j, *expected in RLIABLE["poi"]:
        assert legacy[f"alg{i}", f"alg{j}"] == pytest.approx(expected, abs=1e-9)
        assert own[f"alg{i}", f"alg{j}"] == pytest.approx(expected, abs=0.04)


def test_profiles_are_those_of_rliable(monkeypatch):
    monkeypatch.setattr(ours, "_rows", Legacy(1))
    profiles = ours.performance_profiles(SCORES, np.array(RLIABLE["taus"]))
    for name, theirs in RLIABLE["profile"].items():
        expected = [theirs["fraction_above"], theirs["ci_lo"], theirs["ci_hi"]]
        np.testing.assert_allclose(profiles[name], expected, atol=1e-9)


def test_aggregates_by_hand():
    by_hand = ours.aggregates({"it": np.array([[-1.0, -0.5, -0.05], [-0.8, -0.3, -0.25]])})["it"]
    assert by_hand["mean"].value == pytest.approx(-2.9 / 6)
    assert by_hand["median"].value == pytest.approx(-0.4)  # of -0.9, -0.4, -0.15
    assert by_hand["iqm"].value == pytest.approx(-1.85 / 4)  # without -1 and -0.05: one of six at either end
    assert by_hand["optimality_gap"].value == pytest.approx(2.95 / 6 - 0.1)  # -0.05 counts as -0.1
    assert by_hand["mean"].low < -2.9 / 6 < by_hand["mean"].high
    other = ours.aggregates({"it": np.array([[-1.0, -0.5, -0.05], [-0.8, -0.3, -0.25]])}, optimal=0)["it"]
    assert other["optimality_gap"].value == pytest.approx(2.9 / 6)


def test_the_interval_of_two_runs_by_hand():
    """A mean of two runs on two levels is the greatest once in 16 samples, so both ends are the extremes."""
    interval = ours.aggregates({"it": np.array([[-1.0, -0.4], [-0.5, -0.2]])})["it"]["mean"]
    assert interval == pytest.approx((-0.525, -0.7, -0.35))


def test_improvement_by_hand():
    found = ours.probability_of_improvement(
        {"x": np.array([[-0.2, -0.5], [-0.4, -0.5]]), "y": np.array([[-0.3, -0.5], [-0.3, -0.1]])}
    )
    # level 0: two pairs of four; level 1: two ties, two losses, so a quarter
    assert found["x", "y"].value == 0.375
    assert found["y", "x"] == pytest.approx((0.625, 1 - found["x", "y"].high, 1 - found["x", "y"].low))


def test_a_profile_counts_what_is_above_not_at():
    share, low, high = ours.performance_profiles({"it": np.array([[-0.5], [-0.25]])}, np.array([-1, -0.5, -0.25]))["it"]
    assert share.tolist() == [1, 0.5, 0]
    assert low.tolist() == [1, 0, 0]  # one sample in four is of the lesser alone
    assert high.tolist() == [1, 1, 0]


def test_a_curve_at_a_point_is_the_aggregate_there():
    curve = np.stack([SCORES["alg0"], SCORES["alg1"]], axis=-1)  # [R, K, 2]
    iqm, low, high = ours.iqm_curves({"it": curve})["it"]
    for point, name in enumerate(["alg0", "alg1"]):
        assert (iqm[point], low[point], high[point]) == ours.aggregates({"it": SCORES[name]})["it"]["iqm"]


def test_ranks_by_hand():
    """On level 0 `a` wins and `b` and `c` tie; on level 1 all tie: whichever runs are drawn."""
    found = ours.rank_distribution(
        {
            "a": np.array([[-0.1, -0.5], [-0.2, -0.5]]),
            "b": np.array([[-0.3, -0.5], [-0.3, -0.5]]),
            "c": np.array([[-0.3, -0.5], [-0.3, -0.5]]),
        }
    )
    assert found["a"] == pytest.approx([(1 + 1 / 3) / 2, 1 / 6, 1 / 6])
    assert found["b"] == pytest.approx([1 / 6, (1 / 2 + 1 / 3) / 2, (1 / 2 + 1 / 3) / 2])
    assert found["c"] == pytest.approx(found["b"])


def test_ranks_are_of_the_same_seeds():
    """With the seeds that make it good, `a` is better by a hair on each; drawn apart they would change places."""
    base = np.array([[-0.9], [-0.1], [-0.5], [-0.3]])
    found = ours.rank_distribution({"a": base, "b": base - 1e-3})
    assert found["a"].tolist() == [1, 0]


def test_a_paired_test_by_hand():
    """Of the 8 sign flips of (0.1, 0.2, 0.3) two reach 0.6 in size; of (0.1, 0.2, -0.1) all but two reach 0.2."""
    y = np.full((3, 1), -0.5)
    found = ours.paired_test(y + np.array([[0.1], [0.2], [0.3]]), y)
    assert (found.difference, found.p) == (pytest.approx(0.2), 2 / 8)
    assert (found.low, found.high) == pytest.approx((0.1, 0.3))  # each end is a sample in 27
    assert ours.paired_test(y + np.array([[0.1], [0.2], [-0.1]]), y).p == 6 / 8


def test_drawn_flips_are_near_all_of_them():
    x, y = SCORES["alg3"][:4], SCORES["alg2"][:4]  # 2^12 flips
    every, some = ours.paired_test(x, y).p, ours.paired_test(x, y, permutations=4000).p
    assert some == pytest.approx(every, abs=4 * np.sqrt(every / 4000))
    assert some != every
    assert some * 4001 == pytest.approx(round(some * 4001))


def test_a_test_sees_what_is_there_and_not_what_is_not():
    far = ours.paired_test(SCORES["alg1"], SCORES["alg4"])
    assert far.p == 1 / 10_001
    assert far.low > 0.2
    same = ours.paired_test(SCORES["alg1"], SCORES["alg1"])
    assert same == (0, 0, 0, 1)


def test_of_a_single_run_nothing_is_said_about_others():
    single = {"a": np.array([[-0.5, -0.3]]), "b": np.array([[-0.6, -0.4]])}
    nan = pytest.approx(np.nan, nan_ok=True)
    assert ours.aggregates(single)["a"]["mean"] == (-0.4, nan, nan)
    assert ours.probability_of_improvement(single)["b", "a"] == (0, nan, nan)
    assert [column.tolist() for column in ours.performance_profiles(single, np.array([-0.4]))["a"]] == [
        [0.5],
        [nan],
        [nan],
    ]
    assert [column.tolist() for column in ours.iqm_curves({"a": single["a"][..., None]})["a"]] == [[-0.4], [nan], [nan]]
    assert ours.rank_distribution(single)["a"].tolist() == [nan, nan]
    assert ours.paired_test(single["a"], single["b"]) == (pytest.approx(0.1), nan, nan, 0.5)


@given(scores, scores)
def test_what_holds_of_any_scores(x, y):
    given_scores = {"x": x, "y": y, "x again": x.copy()}
    found = ours.aggregates(given_scores, reps=50)
    assert found["x"] == found["x again"] == ours.aggregates({"x": x}, reps=50)["x"]
    for estimate in found["y"].values():
        assert estimate.low <= estimate.high
        assert -1 <= estimate.value <= 0.9
    improvement = ours.probability_of_improvement(given_scores, reps=50)
    assert improvement["x", "y"].value + improvement["y", "x"].value == 1
    assert improvement["x", "x again"].value == 0.5
    ranks = ours.rank_distribution(given_scores, reps=50)
    np.testing.assert_allclose(np.sum(list(ranks.values()), axis=0), 1)  # each rank is someone's
    np.testing.assert_allclose(np.sum(list(ranks.values()), axis=1), 1)
    assert ranks["x"].tolist() == ranks["x again"].tolist()


@given(scores, scores)
def test_a_paired_test_is_of_two_sides(x, y):
    x, y = x[: len(y)], y[: len(x)]
    one, other = ours.paired_test(x, y), ours.paired_test(y, x)
    assert one.p == other.p
    assert one.difference == -other.difference
    assert 0 < one.p <= 1


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (np.full(4, -0.5), r"b: scores of shape \(4,\): give \[runs, levels\]"),
        (np.empty((0, 2)), r"b: scores of shape \(0, 2\)"),
        (np.full((3, 1), -0.5), r"b: scores of shape \(3, 1\), a of \(3, 2\): give the same levels"),
        (np.array([[-0.5, np.nan]]), "b: a score is not finite"),
    ],
)
def test_wrong_scores_are_named(wrong, message):
    with pytest.raises(ValueError, match=message):
        ours.aggregates({"a": np.full((3, 2), -0.5), "b": wrong})


def test_a_paired_test_needs_pairs():
    with pytest.raises(ValueError, match="x has 3 runs, y 2"):
        ours.paired_test(np.full((3, 2), -0.5), np.full((2, 2), -0.5))
