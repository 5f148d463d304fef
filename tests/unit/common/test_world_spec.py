"""The world of a run: which levels there are, what is wrong with those of one's own, and what follows from them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from railctl.common.levels.distributions import LevelFiles, StockLevels, shipped
from railctl.common.rail.observations.table import AnyObservation
from railctl.common.rail.rewards.table import AnyReward
from railctl.common.strict import ConfigError, describe, section_of
from railctl.common.world import WorldSpec, chosen_levels

STOCK = {"rules": "stock", "size": [30, 40], "trains": 20, "cities": 4}
LEGACY = {"rules": "legacy", "size": [30, 40], "trains": 4, "cities": 4}
BREAKS = {"rate": 0.002, "min_steps": 20, "max_steps": 50}
FOUND = {"digest": "0" * 16, "size": [12, 50], "trains": 9, "training": 80, "evaluation": 20}


def world(**changes):
    return WorldSpec.model_validate({"levels": {"rush": STOCK}} | changes)


def said(**changes):
    with pytest.raises(ValidationError) as caught:
        world(**changes)
    text = describe(caught.value, WorldSpec)
    assert "\n" not in text
    return text


# What follows from it


def test_bounds_are_the_most_that_any_levels_have():
    levels = {"rush": STOCK, "mine": {"files": "a.pkl", "found": FOUND}, "old": LEGACY}
    assert world().bounds == (30, 40, 20)
    assert world(levels=levels).bounds == (30, 50, 20)


def test_what_trains_see_has_a_size():
    assert world().n_features == 252  # 21 nodes of 12 numbers
    for model in (section_of(AnyObservation, kind) for kind in ("tree", "global")):
        assert world(observation=model()).n_features == model().n_features(world().bounds)
    assert world(observation={"depth": 1}).n_features == 60


def test_sections_of_the_default_kind_need_not_say_so():
    assert world(observation={"depth": 1}).observation == section_of(AnyObservation, "tree")(depth=1)
    assert world(observation={"kind": "global"}).observation == section_of(AnyObservation, "global")()
    assert world(reward={"kind": "delay"}).reward == section_of(AnyReward, "delay")()
    assert (world().decisions, world().reward.kind, world().interlocking) == ("cells", "study", "off")


def test_an_interlocking_that_is_off_may_be_yaml_s_false():
    assert world(interlocking=False) == world(interlocking="off")


def test_levels_are_known_by_what_they_hold_whatever_they_are_called():
    levels = world(levels={"a": STOCK, "b": STOCK | {"timetable": True}, "c": STOCK | {"trains": 21}}).levels
    assert levels["a"].identity == levels["b"].identity
    assert levels["a"].identity != levels["c"].identity
    assert world(levels={"m": {"files": "a", "found": FOUND}}).levels["m"].identity == "0" * 16


def test_one_file_need_not_be_a_list():
    levels = LevelFiles.model_validate({"files": "a/*.pkl", "evaluation": "b.npz"})
    assert (levels.files, levels.evaluation, levels.rules) == (("a/*.pkl",), ("b.npz",), "stock")
    assert LevelFiles.model_validate({"files": ["a", "b"]}).evaluation == 0.2


def test_files_are_nothing_before_they_are_read():
    levels = LevelFiles(files=("a",))
    for ask in (lambda: levels.bounds, lambda: levels.identity, lambda: levels.evaluation_levels):
        with pytest.raises(ValueError, match="the files were not read yet"):
            ask()
    read = levels.model_copy(update={"found": section_of(LevelFiles.model_fields["found"].annotation)(**FOUND)})
    assert (read.bounds, read.identity, read.evaluation_levels) == ((12, 50, 9), "0" * 16, 20)


SHARES = st.lists(st.integers(1, 9), min_size=1, max_size=4)


@st.composite
def speeds(draw):
    shares = draw(SHARES)
    each = draw(st.lists(st.floats(0.01, 1.0), min_size=len(shares), max_size=len(shares), unique=True))
    return {speed: share / sum(shares) for speed, share in zip(each, shares, strict=True)}


SIDES = st.integers(6, 200)
GENERATED = {
    "size": st.tuples(SIDES, SIDES),
    "trains": st.integers(1, 1000),
    "cities": st.integers(2, 1000),
    "rails_between_cities": st.integers(1, 10),
    "held_out": st.integers(1, 1000),
}
BREAKDOWNS = st.builds(
    lambda rate, least, more: {"rate": rate, "min_steps": least, "max_steps": least + more},
    st.floats(1e-6, 1.0),
    st.integers(1, 500),
    st.integers(0, 500),
)
LEVELS = st.fixed_dictionaries(
    {"rules": st.just("legacy"), **GENERATED, "rails_in_city": st.integers(2, 10)}
) | st.fixed_dictionaries(
    {
        "rules": st.just("stock"),
        **GENERATED,
        "rail_pairs_in_city": st.integers(1, 10),
        "timetable": st.booleans(),
        "speeds": st.none() | speeds(),
        "malfunctions": st.none() | BREAKDOWNS,
    }
)


@settings(deadline=None)
@given(st.dictionaries(st.from_regex(r"\A[A-Za-z0-9][A-Za-z0-9_.-]{0,39}\Z"), LEVELS, min_size=1, max_size=3))
def test_a_world_comes_back_from_plain_data(levels):
    levels.pop("any", None)
    if levels:
        spec = world(levels=levels)
        assert WorldSpec.model_validate(spec.model_dump(mode="json")) == spec
        assert spec.bounds.trains == max(one["trains"] for one in levels.values())


# What is wrong with it


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"rule": "stock"},
            "unknown key levels.rush.rule: did you mean rules? known are cities, held_out, ",
        ),
        ({"rails_in_city": 3}, "unknown key levels.rush.rails_in_city: did you mean rail_pairs_in_city? known are "),
        ({"size": [5, 30]}, "levels.rush.size.0: input should be greater than or equal to 6, not 5"),
        ({"size": [30, 201]}, "levels.rush.size.1: input should be less than or equal to 200, not 201"),
        ({"size": [30]}, "levels.rush.size.1 is missing: give it a value"),
        ({"size": 30}, "levels.rush.size: input should be a list, not 30"),
        ({"trains": 0}, "levels.rush.trains: input should be greater than or equal to 1, not 0"),
        ({"trains": 1001}, "levels.rush.trains: input should be less than or equal to 1000, not 1001"),
        ({"trains": "many"}, "levels.rush.trains: input should be a valid integer, unable to parse "),
        ({"cities": 1}, "levels.rush.cities: input should be greater than or equal to 2, not 1"),
        ({"rails_between_cities": 0}, "levels.rush.rails_between_cities: input should be greater than or equal to 1"),
        ({"rail_pairs_in_city": 11}, "levels.rush.rail_pairs_in_city: input should be less than or equal to 10, not"),
        ({"held_out": 0}, "levels.rush.held_out: input should be greater than or equal to 1, not 0"),
        ({"held_out": 1001}, "levels.rush.held_out: input should be less than or equal to 1000, not 1001"),
        ({"timetable": "soon"}, "levels.rush.timetable: input should be a valid boolean"),
        ({"speeds": {1: 0.5, 0.5: 0.25}}, "levels.rush: the shares of speeds add up to 0.75: make it 1"),
        (
            {"speeds": {"1": 0.5, 1: 0.5}},
            "levels.rush.speeds: a key is there twice in {'1': 0.5, 1: 0.5}: leave one out",
        ),
        ({"speeds": {}}, "levels.rush: the shares of speeds add up to 0: make it 1"),
        ({"speeds": {2: 1}}, "levels.rush.speeds.2: input should be less than or equal to 1, not 2"),
        ({"speeds": {0: 1}}, "levels.rush.speeds.0: input should be greater than or equal to 0.001, not 0"),
        ({"speeds": {1e-9: 1}}, "levels.rush.speeds.1e-09: input should be greater than or equal to 0.001, not 1e-09"),
        ({"speeds": {"fast": 1}}, "levels.rush.speeds.fast: input should be a valid number"),
        ({"speeds": {1: 0}}, "levels.rush.speeds.1: input should be greater than 0, not 0"),
        ({"speeds": 0.5}, "levels.rush.speeds: input should be a valid dictionary, not 0.5"),
        ({"malfunctions": 5}, "levels.rush.malfunctions: input should be a valid dictionary, not 5"),
        ({"malfunctions": {"rate": 0.1}}, "levels.rush.malfunctions.min_steps is missing: give it a value"),
        (
            {"malfunctions": BREAKS | {"rate": 0}},
            "levels.rush.malfunctions.rate: input should be greater than 0",
        ),
        (
            {"malfunctions": BREAKS | {"rate": 2}},
            "levels.rush.malfunctions.rate: input should be less than or equal",
        ),
        (
            {"malfunctions": BREAKS | {"min_steps": 51}},
            "levels.rush.malfunctions: min_steps 51 exceeds max_steps 50: make one fit the other",
        ),
        (
            {"malfunctions": BREAKS | {"max": 3}},
            "unknown key levels.rush.malfunctions.max: did you mean max_steps? known are max_steps, min_steps, rate",
        ),
        ({"rules": "new"}, "levels.rush: say rules: legacy or rules: stock, or give files, not {'rules': 'new', "),
        ({"rules": None}, "levels.rush: say rules: legacy or rules: stock, or give files, not "),
        ({"rules": ["stock"]}, "levels.rush: say rules: legacy or rules: stock, or give files, not "),
        ({"rules": "legacy", "timetable": True}, "unknown key levels.rush.timetable: known are cities, held_out, "),
        ({"rules": "legacy", "speeds": {1: 1}}, "unknown key levels.rush.speeds: known are cities, held_out, "),
        ({"rules": "legacy", "malfunctions": BREAKS}, "unknown key levels.rush.malfunctions: known are cities, held_"),
        (
            {"rules": "legacy", "rails_in_city": 1},
            "levels.rush.rails_in_city: input should be greater than or equal",
        ),
    ],
)
def test_wrong_levels_are_named(changes, text):
    assert said(levels={"rush": STOCK | changes}).startswith(text)


@pytest.mark.parametrize(
    ("levels", "text"),
    [
        ({"files": []}, "levels.rush.files: input should be a list of at least 1 item, not []"),
        ({"files": 5}, "levels.rush.files: input should be a list, not 5"),
        ({"files": [5]}, "levels.rush.files.0: input should be a valid string, not 5"),
        ({"files": "a", "evaluation": 0}, "levels.rush.evaluation: input should be greater than 0, not 0"),
        ({"files": "a", "evaluation": 1}, "levels.rush.evaluation: input should be less than 1, not 1"),
        ({"files": "a", "evaluation": []}, "levels.rush.evaluation: "),
        ({"files": "a", "rules": "new"}, "levels.rush.rules: input should be 'legacy' or 'stock', not 'new'"),
        ({"files": "a", "trains": 3}, "unknown key levels.rush.trains: known are evaluation, files, found, rules"),
        ({"trains": 3}, "levels.rush: say rules: legacy or rules: stock, or give files, not {'trains': 3}"),
        (5, "levels.rush: say rules: legacy or rules: stock, or give files, not 5"),
        (None, "levels.rush: say rules: legacy or rules: stock, or give files, not None"),
    ],
)
def test_levels_that_are_no_distribution_are_named(levels, text):
    assert said(levels={"rush": levels}).startswith(text)


@pytest.mark.parametrize(
    ("levels", "text"),
    [
        ({}, "levels: input should be a dictionary of at least 1 item"),
        ({"any": STOCK}, "levels: any is what actors serve that serve all levels: choose another name"),
        ({"a b": STOCK}, "levels.a b: string should match pattern '^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$', not 'a b'"),
        ({"-a": STOCK}, "levels.-a: string should match pattern "),
        ({"x" * 41: STOCK}, f"levels.{'x' * 41}: string should match pattern "),
        ({5: STOCK}, "levels.5: input should be a valid string, not 5"),
        (["rush"], "levels: input should be a valid dictionary, not ['rush']"),
    ],
)
def test_wrong_names_of_levels_are_named(levels, text):
    assert said(levels=levels).startswith(text)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"observation": {"kind": "gloval"}}, "observation.kind: unknown 'gloval': known are 'tree', 'global'"),
        ({"observation": {"kind": None}}, "observation.kind: unknown 'None': known are "),
        ({"observation": {"depth": 4}}, "observation.depth: input should be less than or equal to 3, not 4"),
        ({"observation": {"depth": 0}}, "observation.depth: input should be greater than or equal to 1, not 0"),
        ({"observation": {"deph": 1}}, "unknown key observation.deph: did you mean depth? known are "),
        ({"observation": {"features": "all"}}, "observation.features: input should be 'detour'"),
        ({"observation": {"kind": "global", "depth": 2}}, "unknown key observation.depth: "),
        ({"observation": 5}, "observation: input should be a valid dictionary, not 5"),
        ({"observation": None}, "observation: input should be a valid dictionary, not None"),
        ({"reward": {"kind": "delays"}}, "reward.kind: unknown 'delays': known are 'study', "),
        ({"reward": {"kind": "study", "weight": 2}}, "unknown key reward.weight: "),
        ({"reward": 1}, "reward: input should be a valid dictionary, not 1"),
        ({"decisions": "always!"}, "decisions: input should be 'cells', 'legacy' or 'always', not 'always!'"),
        ({"decisions": None}, "decisions: input should be 'cells', 'legacy' or 'always', not None"),
        ({"interlocking": "sure"}, "interlocking: input should be 'off', 'valid', 'safe' or 'planned', not 'sure'"),
        ({"interlocking": True}, "interlocking: input should be 'off', 'valid', 'safe' or 'planned', not True"),
        ({"patience": 24}, "patience 24: an interlocking off makes nobody go on, make it safe or planned, or "),
        ({"patience": 9, "interlocking": "valid"}, "patience 9: an interlocking valid makes nobody go on, "),
        (
            {"decisionss": "cells"},
            "unknown key decisionss: did you mean decisions? known are decisions, ",
        ),
    ],
)
def test_what_else_is_wrong_is_named(changes, text):
    assert said(**changes).startswith(text)


# Which levels there are


def test_levels_of_a_name_are_the_runs_own_or_those_that_ship():
    ours = {name: levels.model_dump(mode="json") for name, levels in shipped().items()}
    assert chosen_levels(["rush", "hard"], {"rush": STOCK}) == {"rush": STOCK, "hard": ours["hard"]}
    assert chosen_levels({"easy": 1.0}, {"easy": ours["easy"]}) == {"easy": ours["easy"]}  # as a saved run says it


def test_levels_that_ship_are_those_of_the_study():
    assert list(shipped()) == ["easy", "medium", "hard"]  # by trains
    assert [levels.bounds for levels in shipped().values()] == [(25, 25, 3), (25, 25, 5), (25, 25, 7)]
    assert {levels.rules for levels in shipped().values()} == {"legacy"}


@pytest.mark.parametrize(
    ("names", "own", "text"),
    [
        ([], {}, "mix names no levels: write for example mix: {easy: 1}"),
        (["ruhs"], {"rush": STOCK}, "unknown level 'ruhs': did you mean rush? known are easy, hard, medium, rush"),
        ([5], {}, "unknown level 5: known are easy, hard, medium"),
        (["rush"], None, "levels: input should be a valid dictionary, not None"),
        (["rush"], ["rush"], "levels: input should be a valid dictionary, not ['rush']"),
        (["easy"], {"easy": STOCK}, "levels.easy: these levels ship with the project, give yours another name"),
        (["hard"], {"easy": STOCK}, "levels.easy: these levels ship with the project, give yours another name"),
    ],
)
def test_levels_that_are_not_there_are_named(names, own, text):
    with pytest.raises(ConfigError) as caught:
        chosen_levels(names, own)
    assert str(caught.value) == text


def test_speeds_come_back_as_numbers():
    levels = StockLevels.model_validate(STOCK | {"speeds": {1: 0.5, 0.25: 0.5}})
    plain = levels.model_dump(mode="json")
    assert StockLevels.model_validate(plain).speeds == {1.0: 0.5, 0.25: 0.5}
