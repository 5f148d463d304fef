"""The delay reward and the score, by hand; parity with the library is tested by whole episodes."""

from math import isnan

import numpy as np
from made_rails import EAST, WEST, line, scheduled

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.rewards.delay import DelayReward
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, STOP_MOVING


def paid(level: Level, *actions: int, rules: str = "stock") -> tuple[list[list[float]], float]:
    """Rewards of all steps, all trains doing the same, and the score."""
    world = CompiledWorld(1, level.n_trains, rules=rules, reward=DelayReward())
    world.load(0, level)
    rewards = [world.obey(np.full((1, level.n_trains), action, np.int8))[0].tolist() for action in actions]
    return rewards, world.score(0)


def test_a_late_train_is_paid_on_arrival():
    level = scheduled(line((1, EAST, 5)), arrivals=[4])
    rewards, score = paid(level, *[MOVE_FORWARD] * 6)  # ready, placed, and four cells: two steps late
    assert rewards == [[0]] * 5 + [[-2]]
    assert score == 1 - 2 / 20


def test_a_punctual_train_costs_nothing():
    rewards, score = paid(scheduled(line((1, EAST, 5)), arrivals=[6]), *[MOVE_FORWARD] * 6)
    assert rewards == [[0]] * 6
    assert score == 1


def test_a_train_that_never_departs_costs_its_journey_at_full_speed():
    level = scheduled(line((1, EAST, 5), max_steps=3), speeds=[(2, 5)])
    rewards, score = paid(level, *[DO_NOTHING] * 3)
    assert rewards == [[0], [0], [-13]]  # five cells, with its own, at 2/5: 12.5 steps
    assert score == 0  # no train loses more than the step limit


def test_a_train_on_the_way_costs_what_it_will_be_late():
    level = scheduled(line((1, EAST, 5), max_steps=6), arrivals=[7])
    rewards, _ = paid(level, *[MOVE_FORWARD] * 3, *[STOP_MOVING] * 3)
    assert rewards[-1] == [-3]  # at the limit it is on column 2; four cells, with its own, make it arrive at 10
    early = scheduled(line((1, EAST, 5), max_steps=6), arrivals=[60])
    assert paid(early, *[MOVE_FORWARD] * 3, *[STOP_MOVING] * 3)[0][-1] == [0]


def test_a_train_without_a_way_has_no_travel_time():
    level = scheduled(line((1, EAST, 5), max_steps=2), headings=[0b0010])
    cut = level.grid.copy()
    cut[0, 2:4] = 0x0100, 0x0004  # the line ends on both sides of the gap
    rewards, score = paid(Level(cut, level.starts, level.targets, 2, level.schedule), DO_NOTHING, DO_NOTHING)
    assert rewards == [[0], [0]]
    assert score == 1


def test_the_score_counts_all_trains_and_is_known_at_the_end():
    level = scheduled(line((3, EAST, 5), (1, WEST, 0), max_steps=10), arrivals=[2, 10])
    world = CompiledWorld(1, 2, rules="stock")
    world.load(0, level)
    for _ in range(4):
        assert isnan(world.score(0))
        world.obey(np.full((1, 2), MOVE_FORWARD, np.int8))
    assert world.over()[0]
    assert world.score(0) == 1 - 2 / (2 * 10)


def test_without_a_timetable_the_limit_is_the_latest_arrival_and_legacy_episodes_have_no_score():
    rewards, score = paid(line((1, EAST, 5), max_steps=5), *[MOVE_FORWARD] * 5, rules="legacy")
    assert rewards == [[0]] * 5  # arrived on step 5
    assert isnan(score)
    rewards, _ = paid(line((1, EAST, 5), max_steps=4), *[MOVE_FORWARD] * 4, rules="legacy")
    assert rewards[-1] == [-2]  # on column 4, with its own two cells to go
