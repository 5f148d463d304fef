"""Behind an interlocking nobody is ever without a way home, and somebody can always move."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_rails import EAST, WEST, fork, line, scheduled
from plain_search import everybody_gets_home

from railctl.common.levels.distributions import LegacyLevels, MalfunctionSettings, StockLevels
from railctl.common.levels.level import Level
from railctl.common.levels.supply import LevelSupply
from railctl.common.rail.asking import unasked
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE
from railctl.common.rail.compiled.decisions import DECISIONS
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.interlocking.asking import FORWARD, STOP, allowed, begin, grant, next_asked
from railctl.common.rail.interlocking.proof import is_proven, settle
from railctl.common.rail.interlocking.signals import INTERLOCKINGS, PLANNED, Signals
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, STOP_MOVING

MALFUNCTIONS = MalfunctionSettings(rate=0.05, min_steps=1, max_steps=12)
LEVELS = {
    "legacy": LegacyLevels(rules="legacy", size=(20, 20), trains=6, cities=2),
    "stock": StockLevels(
        rules="stock", size=(25, 25), trains=6, cities=2, timetable=False,
        speeds={1.0: 0.5, 0.5: 0.25, 0.25: 0.25}, malfunctions=MALFUNCTIONS,
    ),
}  # fmt: skip


class Watched:
    """A world of one slot behind an interlocking, whose trains take random actions of those allowed."""

    def __init__(self, level: Level, rules: str, mode: str, decisions: str, seed: int) -> None:
        self.world = CompiledWorld(1, level.n_trains, rules=rules, decisions=decisions, interlocking=mode)
        self.world.load(0, level, malfunction_seed=seed)
        parts = self.world.parts()
        self.batch, self.signals, self.deciding = parts.batch, parts.signals, parts.deciding[0]
        self.mode, self.decisions = INTERLOCKINGS[mode], DECISIONS[decisions]
        self._rng = np.random.default_rng(seed)

    @property
    def trains(self) -> np.ndarray:
        return self.batch.trains[0]

    def begin(self) -> Signals:
        begin(self.batch, 0, self.mode, self.decisions, self.signals)
        return self.signals

    def asked(self) -> dict[int, int]:
        """What those that decide are allowed, one after the other; each takes something of it."""
        self.begin()
        found, actions = {}, np.full((1, self.world.max_trains), MOVE_FORWARD, np.int8)
        actions[0] = [unasked(self.batch.codes[0], train["config"], self.mode) for train in self.trains]
        while (train := next_asked(self.batch, 0, self.deciding, self.signals)) != NOTHING:
            bits = allowed(self.batch, 0, self.mode, train, self.signals)
            choices = [action for action in range(5) if bits >> action & 1]
            found[train] = bits
            actions[0, train] = self._rng.choice(choices)
            grant(self.batch, 0, self.mode, train, int(actions[0, train]), self.signals)
        self._actions = actions
        return found

    def step(self) -> None:
        self.world.step(self._actions)

    def resting(self) -> tuple[int, ...]:
        """Where trains come to rest if nobody is granted anything more."""
        signals, trains = self.begin(), range(self.world.max_trains)
        return tuple(
            NOWHERE if (rest := int(signals.trains[at]["rest"])) == NOTHING else int(signals.routes[at, rest])
            for at in trains
        )

    def is_proven(self) -> bool:
        signals = self.begin()
        settle(self.batch, 0, signals)
        return is_proven(self.batch, 0, signals, NOTHING, self.mode == PLANNED)

    def stands(self) -> bool:
        """Whether somebody is on the map, and nobody moves on or is broken down."""
        signals, on_map = self.begin(), self.trains["config"] != NOWHERE
        still = (signals.trains["rest"] == 0) & self.deciding & (self.trains["malfunction"] == 0)
        return bool(on_map.any() and still[on_map].all())


@settings(deadline=None, max_examples=12)
@given(
    rules=st.sampled_from(["legacy", "stock"]),
    mode=st.sampled_from(["safe", "planned"]),
    decisions=st.sampled_from(["cells", "always", "legacy"]),
    seed=st.integers(0, 10_000),
)
def test_from_a_safe_state_only_safe_ones_follow_and_somebody_can_always_move(rules, mode, decisions, seed):
    level = LevelSupply(LEVELS).training(rules, seed)
    watched = Watched(level, rules, mode, decisions, seed)
    for _ in range(150):
        if watched.world.over()[0]:
            break
        assert watched.is_proven()
        stands = watched.stands()
        found = watched.asked()
        assert all(bits for bits in found.values())
        assert not stands or any(bits & ~STOP for bits in found.values())
        watched.step()


@settings(deadline=None, max_examples=6)
@given(mode=st.sampled_from(["safe", "planned"]), seed=st.integers(0, 10_000))
def test_a_plain_search_finds_everybody_a_way_home(mode, seed):
    level = LevelSupply(LEVELS).training("legacy", seed)
    few = replace(level, starts=level.starts[:4], targets=level.targets[:4])
    watched = Watched(few, "legacy", mode, "cells", seed)
    searched = set()
    for _ in range(80):
        if watched.world.over()[0]:
            break
        places = watched.resting()
        if places not in searched:
            searched.add(places)
            assert everybody_gets_home(watched.batch, places)
        watched.asked()
        watched.step()
    assert searched


@pytest.mark.parametrize("mode", ["safe", "planned"])
def test_of_two_trains_head_on_one_departs_and_the_other_as_it_leaves_where_that_one_starts(mode):
    watched = Watched(line((1, EAST, 6), (5, WEST, 0)), "legacy", mode, "cells", 0)
    watched.begin()
    assert allowed(watched.batch, 0, watched.mode, 0, watched.signals) == FORWARD | STOP
    assert allowed(watched.batch, 0, watched.mode, 1, watched.signals) == FORWARD | STOP
    grant(watched.batch, 0, watched.mode, 0, MOVE_FORWARD, watched.signals)
    assert allowed(watched.batch, 0, watched.mode, 1, watched.signals) == STOP
    for column in range(1, 6):
        watched.world.step(np.array([[MOVE_FORWARD, STOP_MOVING]], np.int8))
        assert watched.batch.cells[0, watched.trains[0]["config"] >> 2]["column"] == column
        watched.begin()
        expected = FORWARD | STOP if column == 5 else STOP
        assert allowed(watched.batch, 0, watched.mode, 1, watched.signals) == expected
    watched.world.step(np.array([[MOVE_FORWARD, MOVE_FORWARD]], np.int8))
    assert watched.world.arrived()[0].tolist() == [True, False]
    assert watched.trains[1]["config"] == watched.trains[1]["start"]


@pytest.mark.parametrize("mode", ["safe", "planned"])
def test_a_train_departs_behind_one_with_its_heading_or_before_it(mode):
    watched = Watched(line((1, EAST, 6), (3, EAST, 6)), "legacy", mode, "cells", 0)
    for _ in range(5):
        watched.begin()
        assert allowed(watched.batch, 0, watched.mode, 1, watched.signals) == FORWARD | STOP
        watched.world.step(np.array([[MOVE_FORWARD, STOP_MOVING]], np.int8))


def test_a_train_that_breaks_down_as_it_is_granted_a_move_is_bound_to_it():
    level = scheduled(line((1, EAST, 6)))
    watched = Watched(level, "stock", "safe", "always", 0)
    for _ in range(3):
        watched.world.step(np.array([[MOVE_FORWARD]], np.int8))
    train = watched.trains[0]
    train["malfunction"], here = 2, int(train["config"])
    watched.world.step(np.array([[MOVE_FORWARD]], np.int8))
    assert train["config"] == here
    watched.begin()
    assert allowed(watched.batch, 0, watched.mode, 0, watched.signals) == FORWARD
    while train["config"] == here:
        watched.world.step(np.array([[MOVE_FORWARD]], np.int8))
    watched.begin()
    assert allowed(watched.batch, 0, watched.mode, 0, watched.signals) == FORWARD | STOP


@pytest.mark.parametrize("mode", ["valid", "safe", "planned"])
def test_who_starts_where_rails_only_branch_off_departs_by_turning(mode):
    level = replace(fork(0), starts=np.array([[1, 2, EAST]], np.int32))
    watched = Watched(level, "legacy", mode, "cells", 0)
    watched.begin()
    assert allowed(watched.batch, 0, watched.mode, 0, watched.signals) == 1 << MOVE_LEFT | STOP
    watched.world.step(np.array([[MOVE_LEFT]], np.int8))
    assert watched.trains[0]["config"] == watched.trains[0]["start"]


def test_where_there_is_no_way_home_nobody_goes():
    level = line((1, EAST, 6), (4, WEST, 4))
    watched = Watched(level, "legacy", "safe", "cells", 0)
    watched.batch.distances[0, 0, :] = 32767
    watched.begin()
    assert allowed(watched.batch, 0, watched.mode, 0, watched.signals) == STOP
