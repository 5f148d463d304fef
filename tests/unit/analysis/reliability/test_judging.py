"""Ranks, resampling and significance."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from railctl.analysis.reliability import Curves, Switches, judge, sensitivity
from railctl.analysis.reliability.draws import KeyedDraws, ToolDraws
from railctl.analysis.reliability.ranks import mean_ranks, own_ranks, penalties, pooled_ranks, rank_among
from railctl.analysis.reliability.resampling import bootstrapped_runs, permuted_difference, permuted_runs
from railctl.analysis.reliability.significance import differing

RETURNS = st.integers(-16, 0).map(lambda number: number / 16)


def drawn(*shape, seed=0):
    return np.random.Generator(np.random.Philox(key=seed)).uniform(-1, 0, shape)


def made_up(runs=4, seed=0):
    return Curves(drawn(3, 2, runs, 24, seed=seed), block=4, zones=2)


def test_ranks_pool_runs_and_share_places():
    values = np.array([[[0.1, 0.3]], [[0.3 + 1e-12, 0.5]]])  # two algorithms, a level, two runs
    assert pooled_ranks(penalties(values, bigger_is_better=False)).tolist() == [[[1, 2.5]], [[2.5, 4]]]
    assert pooled_ranks(penalties(values, bigger_is_better=True)).tolist() == [[[4, 2.5]], [[2.5, 1]]]
    assert own_ranks(values).tolist() == [[[1, 2]], [[1, 2]]]
    assert mean_ranks(np.round(values, 10)).tolist() == [1.75, 3.25]
    assert np.isnan(mean_ranks(np.array([[0.1], [np.inf]]))).all()


def test_rank_beside_others():
    others = np.array([[1.0], [2], [2]])
    assert rank_among(np.array([0.0]), others) == 1
    assert rank_among(np.array([2.0]), others) == 3
    assert rank_among(np.array([np.inf]), others) == 4
    assert np.isnan(rank_among(np.array([np.nan]), others))


@given(arrays(float, (3, 2, 3), elements=RETURNS))
def test_ranks_of_a_level_add_up(values):
    assert pooled_ranks(values).sum((0, 2)).tolist() == [45, 45]  # 1 + .. + 9


def test_a_bootstrap_ranks_everything_anew():
    worse = penalties(made_up().returns[..., 0], bigger_is_better=True)
    draws = KeyedDraws(runs=4, bootstraps=20, permutations=1)
    ours = bootstrapped_runs(worse, draws)
    for sample, chosen in enumerate(draws.choices(2)):
        for algorithm in range(3):
            again = worse.copy()
            for level in range(2):
                again[algorithm, level] = worse[algorithm, level, chosen[level]]
            assert ours[algorithm, sample] == mean_ranks(again)[algorithm]


def test_a_permutation_deals_out_the_ranks_of_a_pair():
    worse = np.array([[[1.0, 2]], [[3, 4]], [[5, 6]]])
    differences = permuted_runs(worse, KeyedDraws(runs=2, bootstraps=1, permutations=300))
    assert set(differences[0].tolist()) == {-2, -1, 0, 1, 2}  # ranks 1, 2 against 3, 4
    assert set(differences[1].tolist()) == {-4, -1, 0, 1, 4}  # 1, 2 against 5, 6: for 1, 5 against 2, 6 it is 1


def test_permuted_curves_are_ranked_among_all():
    worse = np.array([[1.0], [3], [5]])
    samples = np.array([[[2.0], [4]], [[6], [4]], [[0], [5]], [[2], [np.nan]]])  # of the first and the last
    differences = permuted_difference(worse, (0, 2), samples)
    np.testing.assert_array_equal(differences, [2, -1, 2, np.nan])


def test_two_rules_of_benjamini_and_yekutieli():
    p_values = np.array([0.032, 0.03])  # the tool: 0.03 against 0.025, 0.032 against 0.0333; the textbook: both 0.048
    assert differing(p_values, 0.05, "tool") == [0]
    assert differing(p_values, 0.05, "textbook") == [0, 1]
    assert differing(p_values, 0.05, "bonferroni") == []
    assert differing(p_values, 0.05, "none") == [0, 1]
    assert differing(np.array([0.02, 0.001, 0.9, 0.03]), 0.05, "tool") == [1]
    assert differing(np.zeros(0), 0.05, "textbook") == []


def test_the_legacy_generator_draws_as_if_asked_one_by_one():
    draws = ToolDraws(runs=4)
    state = np.random.RandomState(0)
    first = [[state.choice(range(4), size=4, replace=True).tolist() for _ in range(2)] for _ in range(3)]
    assert draws.choices(2)[:3].tolist() == first
    state = np.random.RandomState(0)
    assert draws.shuffles(1)[:3, 0].tolist() == [state.permutation(range(8)).tolist() for _ in range(3)]


def test_judging_repeats_and_the_number_of_draws_is_told():
    document = judge(made_up(), bootstraps=10, permutations=20)
    assert document == judge(made_up(), bootstraps=10, permutations=20)
    assert (document["n_resamples"], document["n_permutations"]) == (10, 20)
    assert judge(made_up(), protocol="tool", keys=["SRT"])["n_permutations"] == 1000


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(3)), st.integers(0, 1000))
def test_who_comes_first_does_not_matter(order, seed):
    curves = made_up(seed=seed)
    other = Curves(curves.returns[order], curves.block, curves.zones)
    before, after = (judge(each, bootstraps=20, permutations=1, keys=["DT", "DR", "LRT"]) for each in (curves, other))
    for key, record in before["metrics"].items():
        for zone, said in record["stats"]["all"].items():
            again = after["metrics"][key]["stats"]["all"][zone]
            assert [said["mean_rank"][index] for index in order] == again["mean_rank"]
            assert [said["ci95"][index] for index in order] == again["ci95"]


@pytest.mark.parametrize("shape", [(1, 1, 1, 2), (1, 2, 3, 8), (2, 1, 1, 6), (2, 1, 2, 4), (3, 2, 5, 6)])
@pytest.mark.parametrize("constant", [None, -0.25])
def test_any_shape_can_be_judged(shape, constant):
    returns = drawn(*shape) if constant is None else np.full(shape, constant)
    for zones in range(1, shape[3] // 2 + 1):
        curves = Curves(returns, block=2, zones=zones)
        for protocol in ("default", "tool"):
            document = judge(curves, protocol=protocol, bootstraps=5, permutations=5)
            assert json.loads(json.dumps(document, allow_nan=False)) == document
            for said in document["metrics"]["DT"]["stats"]["all"].values():
                assert sum(said["mean_rank"]) == pytest.approx(sum(range(1, shape[0] * shape[2] + 1)) / shape[2] ** 2)


def test_runs_without_range_have_no_ranks():
    returns = made_up().returns.copy()
    returns[1, 0, 2] = -0.5
    document = judge(Curves(returns, 4, 2), bootstraps=5, permutations=5, keys=["SRT_cr", "DT_cr", "SRT"])
    for key in ("SRT_cr", "DT_cr"):
        for said in document["metrics"][key]["stats"]["all"].values():
            assert said["mean_rank"] == ["nan"] * 3
            assert "not finite" in said["note"]
    assert document["metrics"]["SRT_cr"]["values"][1][0][2] == "nan"
    assert "ci95" in document["metrics"]["SRT"]["stats"]["all"]["whole"]


def test_centred_curves_are_compared_by_their_spread_alone():
    curves = made_up(runs=5)
    shift = np.array([0.0, -0.5, 0])[:, None, None, None]
    shifted = Curves(curves.returns / 2 + shift, 4, 2)
    halved = Curves(curves.returns / 2, 4, 2)

    def pairs(of, *, centred):
        document = judge(of, bootstraps=1, permutations=200, keys=["DR"], switches=Switches(dr_center=centred))
        return document["metrics"]["DR"]["stats"]["all"]["zone0"]["pairs"]

    assert pairs(halved, centred=True) == pairs(shifted, centred=True)
    assert pairs(halved, centred=False) != pairs(shifted, centred=False)


def test_sensitivity_names_every_switch_and_what_it_changes(oracle):
    curves, theirs = oracle["main"]
    rows = {(row["metric"], row["switch"], row["value"], row["zone"]): row for row in sensitivity(curves)}
    json.dumps(list(rows.values()), allow_nan=False)
    assert {switch for _, switch, *_ in rows} == set(Switches.model_fields)
    for place, key in {
        ("DT", "normalize", "curve_range", "zone1"): "DT_cr",
        ("DR", "normalize", "curve_range_block", "zone2"): "DR_cr",
        ("SRT", "risk_curve", "moving_average", "whole"): "SRT_ma",
        ("LRT", "drawdown_tail", "lower", "whole"): "LRT_lower",
        ("LRT", "drawdown_tail", "upper", "whole"): "LRT",
    }.items():
        expected = theirs["metrics"][key]["stats"]["all"][place[-1]]["mean_rank"]
        np.testing.assert_allclose(rows[place]["mean_rank"], expected, atol=1e-9)
    assert rows["LRT", "drawdown_tail", "lower", "whole"]["order_changed"] is True  # it is 0 everywhere
    assert rows["LRT", "drawdown_tail", "upper", "whole"]["order_changed"] is False
    assert all(row["order_changed"] is False for place, row in rows.items() if place[1] == "dr_center")


def test_sensitivity_where_ranks_are_undefined():
    returns = made_up().returns.copy()
    returns[0, 0, 0] = -0.5
    rows = [row for row in sensitivity(Curves(returns, 4, 2)) if row["mean_rank"] == ["nan"] * 3]
    assert rows
    assert {row["switch"] for row in rows} == {"normalize"}
    assert all(row["order_changed"] is None for row in rows)
