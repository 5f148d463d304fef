"""Shaped rewards by hand."""

import numpy as np
import pytest
from made_rails import EAST, WEST, line, ring, scheduled
from pydantic import TypeAdapter, ValidationError

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.rewards.delay import DelayReward
from railctl.common.rail.rewards.shaped import ShapedReward
from railctl.common.rail.rewards.study import StudyReward
from railctl.common.rail.rewards.table import AnyReward, weights_of
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, STOP_MOVING

NOTHING = {"step": 0, "all_arrived": 0}


def paid(level: Level, reward: ShapedReward, actions: list[list[int]], rules: str = "legacy") -> list[list[float]]:
    """Rewards of all steps."""
    world = CompiledWorld(1, level.n_trains, rules=rules, reward=reward)
    world.load(0, level)
    return [world.obey(np.array([step], np.int8))[0].tolist() for step in actions]


def test_the_defaults_are_the_study_s():
    level, actions = line((3, EAST, 5), (2, EAST, 6)), [[MOVE_FORWARD] * 2] * 5
    assert paid(level, ShapedReward(), actions) == [[-1, -1], [-1, -1], [0, -1], [0, -1], [1, 1]]


def test_arrivals_are_paid_once_each_and_the_last_one_to_all():
    level, actions = line((3, EAST, 5), (2, EAST, 6)), [[MOVE_FORWARD] * 2] * 5
    reward = ShapedReward(step=-0.5, arrival=3, all_arrived=10)
    assert paid(level, reward, actions) == [[-0.5, -0.5], [-0.5, -0.5], [3, -0.5], [0, -0.5], [10, 13]]


def test_progress_is_paid_by_the_cell():
    level = line((1, EAST, 4))
    reward = ShapedReward(**NOTHING, progress=0.25)
    # onto the map: no nearer; a cell; a stop; two cells, the last on arrival
    actions = [[MOVE_FORWARD], [MOVE_FORWARD], [STOP_MOVING], [MOVE_FORWARD], [MOVE_FORWARD]]
    assert paid(level, reward, actions) == [[0], [0.25], [0], [0.25], [0.25]]


def test_progress_after_a_target_was_passed_the_wrong_way_evens_out():
    level = scheduled(line((2, EAST, 3)), headings=[0b1000])
    rewards = paid(level, ShapedReward(**NOTHING, progress=1), [[MOVE_FORWARD]] * 10, rules="stock")
    assert sum(reward for [reward] in rewards) == 7  # cells from its start to the end of the line and back
    assert all(reward >= 0 for [reward] in rewards)


def test_the_delay_reward_is_weighted():
    level = scheduled(line((1, EAST, 5)), arrivals=[4])
    rewards = paid(level, ShapedReward(**NOTHING, delay=0.5), [[MOVE_FORWARD]] * 6, rules="stock")
    assert rewards == [[0]] * 5 + [[-1]]


def test_a_deadlock_is_paid_once_to_each_train_as_it_gets_into_it():
    level = line((2, EAST, 6), (4, WEST, 0), (1, EAST, 6))
    reward = ShapedReward(**NOTHING, deadlock=-7)
    on_map = [[MOVE_FORWARD] * 3]
    assert paid(level, reward, on_map) == [[0, 0, 0]]  # a cell is between the first two
    meeting = [[MOVE_FORWARD, STOP_MOVING, STOP_MOVING], [STOP_MOVING] * 3]
    assert paid(level, reward, on_map + meeting) == [[0, 0, 0], [-7, -7, 0], [0, 0, 0]]
    follows = [*meeting, [DO_NOTHING, DO_NOTHING, MOVE_FORWARD], [DO_NOTHING] * 3]
    assert paid(level, reward, on_map + follows) == [[0, 0, 0], [-7, -7, 0], [0, 0, 0], [0, 0, -7], [0, 0, 0]]


def test_a_full_ring_is_no_deadlock():
    level = ring(2, (0, 1, 1), (1, 1, 2), (1, 0, 3), (0, 0, 0))
    rewards = paid(level, ShapedReward(**NOTHING, deadlock=-7), [[MOVE_FORWARD] * 4, [STOP_MOVING] * 4])
    assert not np.any(rewards)


@pytest.mark.parametrize(
    ("reward", "floor"),
    [(StudyReward(), -1), (DelayReward(), 0), (ShapedReward(), -1), (ShapedReward(step=0.5, deadlock=-9), 0)],
)
def test_floors(reward: AnyReward, floor: float):
    assert reward.floor == floor


def test_the_table_knows_every_kind():
    adapter: TypeAdapter[AnyReward] = TypeAdapter(AnyReward)
    for kind in ("study", "delay", "shaped"):
        assert adapter.validate_python({"kind": kind}).kind == kind
    assert weights_of(ShapedReward(step=-2, delay=3)).tolist() == [2, -2, 0, 1, 0, 0, 3]
    assert len({weights_of(reward)[0] for reward in (StudyReward(), DelayReward(), ShapedReward())}) == 3
    for wrong in ({"kind": "none"}, {"kind": "study", "step": -1}, {"kind": "shaped", "step": float("inf")}):
        with pytest.raises(ValidationError):
            adapter.validate_python(wrong)
