"""The planner that plans anew: what it takes on beyond the other one."""

import numpy as np
from made_rails import EAST, WEST, line, scheduled

from railctl.common.levels.level import Malfunctions
from railctl.common.levels.supply import LevelSupply
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.world import MOVE_LEFT, MOVE_RIGHT
from railctl.services.evaluator.references.policies import reference_policy


def arrivals(level, rules="legacy", **options):
    """Steps until each train has arrived, 0 for never."""
    world = CompiledWorld(1, level.n_trains, rules=rules)
    return (reference_policy("planner-replanned", world, **options)(0, level).arrived_at + 1).tolist()


def test_trains_that_meet_wait_for_each_other():
    assert arrivals(line((2, EAST, 6), (3, WEST, 0))) == [7, 4]


def test_slow_trains_and_departures_are_planned_for():
    level = line((2, EAST, 6), (3, WEST, 0))
    slow = scheduled(level, speeds=[(1, 1), (1, 2)])
    assert arrivals(slow, "stock", orders=1) == [6 + 4, 2 + 3 * 2]  # the slow one is nearer, and goes first
    assert arrivals(slow, "stock", orders=9) == [2 + 4, 4 + 3 * 2]
    assert arrivals(scheduled(level, departures=[0, 3]), "stock") == [2 + 4, 4 + 3]


def test_all_arrive_though_trains_break_down():
    levels = (LevelSupply().evaluation("easy", index) for index in range(4))
    for level in levels:
        broken = scheduled(level, malfunctions=Malfunctions(0.02, 2, 6))
        assert min(arrivals(broken, "stock", orders=3)) > 0


def test_draws_are_those_of_seed_and_number():
    level = LevelSupply().evaluation("hard", 2)
    policies = [reference_policy("planner-replanned", CompiledWorld(1, 7), seed, orders=3) for seed in (1, 1, 2)]
    first, again, other = (policy(5, level).decisions.actions for policy in policies)
    np.testing.assert_array_equal(first, again)
    assert len(first) != len(other) or (first != other).any()


def test_trains_turn_where_rails_do():
    level, world = LevelSupply().evaluation("medium", 0), CompiledWorld(1, 5)
    course = reference_policy("planner-replanned", world, orders=1)(0, level)
    assert (course.arrived_at >= 0).all()
    assert {MOVE_LEFT, MOVE_RIGHT} < set(course.decisions.actions.tolist())
