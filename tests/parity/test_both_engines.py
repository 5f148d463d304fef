"""Both engines give the same episodes, to the bit, whatever the rules, what trains see, decide and are paid."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_rails import EAST, ring, scheduled
from stock_levels import MIXED, stock_level

from railctl.common.levels.distributions import Bounds
from railctl.common.levels.level import Level, Malfunctions
from railctl.common.levels.shipped import generate
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.flatland_world import FlatlandWorld
from railctl.common.rail.observations.global_map import GlobalObservation
from railctl.common.rail.observations.local_map import LocalObservation
from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.rail.rewards.delay import DelayReward
from railctl.common.rail.rewards.shaped import ShapedReward
from railctl.common.rail.rewards.study import StudyReward

MIXES = ([0.2] * 5, [0.05, 0.1, 0.7, 0.1, 0.05], [0.0, 0.0, 1.0, 0.0, 0.0])
SHAPED = ShapedReward(step=-0.5, arrival=3, all_arrived=2, progress=0.25, deadlock=-7, delay=0.125)
OFTEN = Malfunctions(1 / 40, 3, 12)
SETTINGS: list[dict[str, Any]] = [
    {},
    {"observation": TreeObservation(depth=1), "reward": DelayReward(), "decisions": "always"},
    {"observation": TreeObservation(depth=3, features="plain"), "reward": SHAPED, "decisions": "legacy"},
    {"observation": TreeObservation(conflicts="repaired"), "reward": SHAPED},
    {"observation": GlobalObservation(), "reward": StudyReward(), "decisions": "always"},
    {"observation": LocalObservation(radius=3), "reward": DelayReward(), "decisions": "legacy"},
    {"interlocking": "valid", "decisions": "always", "observation": TreeObservation(depth=1)},
    {"interlocking": "safe", "observation": TreeObservation(depth=1), "reward": SHAPED},
    {"interlocking": "planned", "observation": TrafficObservation(others=2), "reward": DelayReward()},
    {"interlocking": "safe", "patience": 3, "decisions": "always", "observation": TreeObservation(depth=1)},
    {"observation": TrafficObservation(others=3)},
    {"observation": TrafficObservation(), "reward": SHAPED, "decisions": "always"},
]
NAMES = [
    *("as-in-the-study", "depth-1-delay-always", "plain-shaped-legacy", "repaired-shaped", "global", "local-delay"),
    *("valid-always", "safe-shaped", "planned-delay", "safe-patience-always"),
    *("traffic", "traffic-always"),
]


def stock_levels(seeds: Sequence[int]) -> list[Level]:
    """With and without a timetable, speeds and malfunctions."""
    kinds: list[dict[str, Any]] = [
        {"speeds": MIXED, "malfunctions": OFTEN},
        {"timetable": False, "malfunctions": OFTEN},
        {"speeds": MIXED},
        {"speeds": {0.4: 0.5, 0.7: 0.5}, "malfunctions": OFTEN, "timetable": False},
    ]
    return [stock_level(seed, 25, 5, 2, **kinds[seed % len(kinds)]) for seed in seeds]


@pytest.mark.parametrize(("first", "settings"), [*enumerate(SETTINGS)], ids=NAMES)
def test_stock_worlds_are_equal(first: int, settings: dict[str, Any]):
    """Three levels, so that a slot is loaded anew; which of the four kinds is left out changes."""
    assert compare_worlds(stock_levels(range(first, first + 3)), rules="stock", **settings) > 100


@pytest.mark.parametrize("settings", SETTINGS, ids=NAMES)
def test_legacy_worlds_are_equal(settings: dict[str, Any]):
    levels = [generate("easy", 3), generate("hard", 4)]
    assert compare_worlds(levels, rules="legacy", **settings) > 50


@pytest.mark.slow
@pytest.mark.parity
@pytest.mark.parametrize("settings", SETTINGS, ids=NAMES)
def test_stock_worlds_are_equal_over_many_levels(settings: dict[str, Any]):
    assert compare_worlds(stock_levels(range(100, 140)), rules="stock", **settings) > 1000


@pytest.mark.slow
@pytest.mark.parity
@pytest.mark.parametrize("difficulty", ["easy", "medium", "hard"])
def test_the_study_s_worlds_are_equal_over_many_levels(difficulty: Any):
    assert compare_worlds([generate(difficulty, seed) for seed in range(100, 160)], rules="legacy") > 1000


def test_worlds_of_10x10_with_one_train_are_equal():
    level = scheduled(ring(10, (0, 4, EAST), max_steps=200), speeds=[(1, 3)], arrivals=[90], malfunctions=OFTEN)
    level = replace(level, targets=np.array([[9, 4]], np.int32))
    settings = {"observation": TreeObservation(features="plain"), "reward": SHAPED, "decisions": "always"}
    assert compare_worlds([level], rules="stock", **settings) > 10


@pytest.mark.parametrize(
    ("side", "trains", "cities", "most_steps"),
    [pytest.param(40, 20, 4, 150, id="40x40-20"), pytest.param(100, 200, 20, 15, id="100x100-200")],
)
def test_worlds_of_any_size_are_equal(side: int, trains: int, cities: int, most_steps: int):
    at_once = side == 100  # so that few steps do
    level = stock_level(5, side, trains, cities, speeds=MIXED, malfunctions=OFTEN, timetable=not at_once)
    settings = {"observation": TreeObservation(features="plain"), "reward": SHAPED, "decisions": "always"}
    assert compare_worlds([level], rules="stock", most_steps=most_steps, **settings) > 500


def ask(slot: int, ours: CompiledWorld, theirs: FlatlandWorld, actions: Any) -> None:
    """Both engines ask the same trains in the same order, and allow them the same; who may not do as it wants stops."""
    assert ours.allowed(slot).tolist() == theirs.allowed(slot).tolist()
    questions = ours.ask(slot), theirs.ask(slot)
    for (train, bits), question in zip(*questions, strict=True):
        assert (train, bits) == question
        if not bits >> int(actions[train]) & 1:
            actions[train] = bits.bit_length() - 1
        for asking in questions:
            asking.grant(train, int(actions[train]))


def compare_worlds(levels: list[Level], most_steps: int = 100_000, **settings: Any) -> int:
    """Random play, step by step; slots are loaded anew when their episode is over; returns how much was observed."""
    slots, most = min(2, len(levels)), max(level.n_trains for level in levels)
    height, width = np.max([level.grid.shape for level in levels], axis=0).tolist()
    bounds = Bounds(height + 1, width, most)  # the grid need not fill its place
    theirs, ours = (engine(slots, most, bounds=bounds, **settings) for engine in (FlatlandWorld, CompiledWorld))
    assert theirs.n_features == ours.n_features
    observation = settings.get("observation", TreeObservation())
    low, high = observation.low, observation.high
    rng = np.random.default_rng(len(levels))
    waiting, observed, scored = list(levels), 0, 0
    for _ in range(most_steps):
        for slot in np.flatnonzero(theirs.over()).tolist()[: len(waiting)]:
            seed = int(rng.integers(1 << 32))
            level = waiting.pop()
            theirs.load(slot, level, seed)
            ours.load(slot, level, seed)
        if not waiting and theirs.over().all():
            break
        deciding = theirs.deciding()
        np.testing.assert_array_equal(ours.deciding(), deciding)
        where, vectors = ours.observe_deciding()
        np.testing.assert_array_equal(where, np.argwhere(deciding))
        for (slot, train), vector in zip(where.tolist(), vectors, strict=True):
            assert low <= vector.min() <= vector.max() <= high
            assert vector.tobytes() == theirs.observe(slot, train).tobytes()
            observed += 1
        actions = rng.choice(5, p=MIXES[len(waiting) % len(MIXES)], size=(slots, most)).astype(np.int8)
        for slot in range(slots):
            ask(slot, ours, theirs, actions[slot])
        assert ours.step(actions).tobytes() == theirs.step(actions).tobytes()
        np.testing.assert_array_equal(ours.arrived(), theirs.arrived())
        np.testing.assert_array_equal(ours.over(), theirs.over())
        for slot in range(slots):
            np.testing.assert_equal(ours.score(slot), theirs.score(slot))
            scored += not np.isnan(ours.score(slot))
        for slot, train in np.argwhere(theirs.over()[:, None] & ~theirs.arrived()).tolist():
            if train < theirs._episodes[slot].level.n_trains:  # what a train sees that the step limit stopped
                assert ours.observe(slot, train).tobytes() == theirs.observe(slot, train).tobytes()
    assert (scored > 0) == (settings["rules"] == "stock" and theirs.over().all())
    return observed
