"""Our numbers beside those of the original tool."""

import json

import numpy as np
import pytest

from railctl.analysis.reliability import RECORDS, judge

EXACT = {"rtol": 1e-9, "atol": 1e-9, "equal_nan": True}


def numbers(nested):
    """Nested lists with "nan" and "inf" in them."""
    return np.array(nested, dtype=object).astype(float)


@pytest.fixture(scope="session", params=["tiny", "main"])
def case(request, oracle):
    """What the tool says of a case, and what we say with its draws."""
    curves, theirs = oracle[request.param]
    return theirs, json.loads(json.dumps(judge(curves, protocol="tool"), allow_nan=False))


def entries(theirs, ours, key):
    """Every scope and zone of a record: ours, theirs, levels."""
    ours, theirs = ours["metrics"][key]["stats"], theirs["metrics"][key]["stats"]
    assert {scope: list(zones) for scope, zones in ours.items()} == {scope: list(theirs[scope]) for scope in theirs}
    for scope, zones in theirs.items():
        for zone, said in zones.items():
            yield ours[scope][zone], said, len(theirs) - 1 if scope == "all" else 1


def test_shape_and_training_curve(case):
    theirs, ours = case
    assert ours["shape"] == theirs["shape"]
    assert list(ours["metrics"]) == list(RECORDS)
    assert set(RECORDS) == set(theirs["metrics"])
    assert set(ours["training_curve"]) == set(theirs["training_curve"])
    for name, curve in theirs["training_curve"].items():
        np.testing.assert_allclose(numbers(ours["training_curve"][name]), numbers(curve), **EXACT)


@pytest.mark.parametrize("key", RECORDS)
def test_values_and_what_they_are(case, key):
    theirs, ours = (document["metrics"][key] for document in case)
    for name in ("tool_class", "params", "dims", "bigger_is_better"):
        assert ours[name] == theirs[name]
    expected = numbers(theirs["values"])
    for place, value in theirs.get("rounding_fragile", []):  # equal values that the tool misses by a rounding error
        expected[tuple(place)] = value
    np.testing.assert_allclose(numbers(ours["values"]), expected, **EXACT)


@pytest.mark.parametrize("key", RECORDS)
def test_ranks_by_zone(case, key):
    for ours, theirs, _ in entries(*case, key):
        assert ours["eval_idx"] == theirs["eval_idx"]
        assert ("note" in ours) == ("note" in theirs)
        for name in ("mean_rank", "bar_height", "ranks"):
            assert (name in ours) >= (name in theirs)
            if name in theirs:
                np.testing.assert_allclose(numbers(ours[name]), numbers(theirs[name]), **EXACT)


@pytest.mark.parametrize("key", [key for key, record in RECORDS.items() if record.resampled])
def test_intervals_p_values_and_significance_with_the_same_draws(case, key):
    compared = [(ours, theirs) for ours, theirs, _ in entries(*case, key) if "ci95" in theirs]
    for ours, theirs in compared:
        np.testing.assert_allclose(numbers(ours["ci95"]), numbers(theirs["ci95"]), **EXACT)
        np.testing.assert_allclose(numbers(ours["pairs"]), numbers(theirs["pairs"]), **EXACT)
        assert theirs["significant"].items() <= ours["significant"].items()
    undefined = all("note" in theirs for _, theirs, _ in entries(*case, key))
    assert compared or undefined or key == "DR_cr"  # which was not resampled in the larger case


@pytest.mark.parametrize("key", ["DT", "DR", "SRT", "LRT"])
def test_our_own_draws_come_to_the_same_but_for_chance(oracle, key):
    curves, theirs = oracle["main"]
    ours = judge(curves, permutations=2000, keys=[key])
    for our, their, levels in entries(theirs, ours, key):
        chance = 1 / levels if key == "DR" else 0.15  # mean ranks of DR lie that far apart
        assert abs(numbers(our["ci95"]) - numbers(their["ci95"])).max() <= chance + 1e-9
        p_ours, p_theirs = numbers(our["pairs"])[:, 3], numbers(their["pairs"])[:, 3]
        middle = (p_ours + p_theirs) / 2
        assert (abs(p_ours - p_theirs) <= 0.002 + 5 * np.sqrt(2 * middle * (1 - middle) / 1000)).all()
        assert p_ours.min() >= 1 / 2001
