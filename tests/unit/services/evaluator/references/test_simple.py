"""Policies without foresight, by hand and beside how networks explore."""

import numpy as np
import pytest

from railctl.common.levels.level import Level
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.player import Acting, play, player
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.world import DO_NOTHING, MOVE_LEFT, MOVE_RIGHT
from railctl.common.rail.world import MOVE_FORWARD as FORWARD
from railctl.common.records.acting import digest_of
from railctl.common.rules.settings import NetworkConfig
from railctl.common.seeding import stream_key
from railctl.common.world import study_world
from railctl.services.evaluator.references.policies import INTERLOCKINGS, reference_policy
from railctl.services.evaluator.references.simple import with_one_train

EAST, WEST = 1, 3
ALONG, WEST_END, EAST_END = 0x0401, 0x0004, 0x0100


def study_player(engine, trains=7, **options):
    """What plays the study's levels."""
    return player(engine, study_world(), "legacy", trains, **options)


def line(*trains, max_steps=20):
    """A line of seven cells; each train is start column, heading, target column."""
    return Level(
        grid=np.array([[WEST_END, ALONG, ALONG, ALONG, ALONG, ALONG, EAST_END]], np.uint16),
        starts=np.array([[0, start, heading] for start, heading, _ in trains], np.int32),
        targets=np.array([[0, target] for _, _, target in trains], np.int32),
        max_steps=max_steps,
    )


def played(name, level, index=0, **options):
    world = CompiledWorld(1, level.n_trains, interlocking=INTERLOCKINGS.get(name, "off"))
    return reference_policy(name, world, **options)(index, level)


def test_random_trains_act_as_a_network_that_only_explores(write_checkpoint, tmp_path):
    network = NetworkConfig(kind="dueling")
    twin = load_policy(write_checkpoint(tmp_path / "weights.safetensors", network)).network
    level = LevelSupply().evaluation("easy", 1)
    acting = Acting(twin, epsilon=1.0, key=stream_key(5, 2, "evaluation-random"))
    expected, ours = play(study_player("compiled", 3), level, acting), played("random", level, 2, seed=5)
    np.testing.assert_array_equal(ours.rewards, expected.rewards)
    ours, expected = ours.decisions, expected.decisions
    told = {(time, train): action for time, train, action in zip(ours.times, ours.trains, ours.actions, strict=True)}
    at = zip(expected.times, expected.trains, strict=True)
    assert [told[place] for place in at] == expected.actions.tolist()


def test_random_trains_are_those_of_seed_and_number():
    level = LevelSupply().evaluation("easy", 0)
    first, *others = (played("random", level, index, seed=seed) for index, seed in ((0, 0), (1, 0), (0, 1)))
    np.testing.assert_array_equal(first.decisions.actions, played("random", level).decisions.actions)
    assert all(first.decisions.actions.tolist() != other.decisions.actions.tolist() for other in others)


def test_greedy_trains_never_wait_and_block_each_other_for_ever():
    recording = played("shortest-path", line((2, EAST, 6), (3, WEST, 0), (5, EAST, 6)))
    assert recording.arrived_at.tolist() == [-1, -1, 1]
    assert recording.rewards.sum(0).tolist() == [-20, -20, -1]
    assert set(recording.decisions.actions.tolist()) == {FORWARD}
    assert recording.normalised_return == -41 / 60


# From the south to a switch, and left or right around a ring to the north:
RING = Level(
    grid=np.array([[0, 0x2000, 0], [0x4002, 0x0858, 0x1200], [0x0048, 0x5202, 0x0810], [0, 0x0080, 0]], np.uint16),
    starts=np.array([[3, 1, 2]], np.int32),
    targets=np.array([[0, 1]], np.int32),
    max_steps=20,
)


def test_of_equally_short_ways_greedy_trains_take_the_left_one():
    assert played("shortest-path", RING).decisions.actions.tolist() == [
        FORWARD,
        FORWARD,
        MOVE_LEFT,
        FORWARD,
        FORWARD,
        FORWARD,
    ]
    assert (
        played("deadlock-avoidance", RING).decisions.actions.tolist()[2] == MOVE_RIGHT
    )  # the east comes before the west


@pytest.mark.parametrize("name", ["shortest-path-safe", "shortest-path-planned"])
def test_behind_an_interlocking_a_train_alone_takes_the_shortest_path(name):
    assert played(name, RING).decisions.actions.tolist()[2] == MOVE_LEFT
    for seed in range(5):
        level = LevelSupply().evaluation("hard", seed)
        for train in range(level.n_trains):
            single = with_one_train(level, train)
            assert played(name, single).arrived_at.tolist() == played("shortest-path", single).arrived_at.tolist()


def test_a_train_without_a_path_stays_off_the_map_and_in_nobodys_way():
    level = line((1, EAST, 6), (5, EAST, 6), (1, EAST, 2))
    level.grid[0, 3], level.grid[0, 4] = EAST_END, WEST_END
    for name in ("shortest-path", "planner", "alone"):
        recording = played(name, level)
        assert recording.arrived_at.tolist() == [-1, 1, 1], name
        assert set(recording.decisions.actions[recording.decisions.trains == 0].tolist()) == {DO_NOTHING}, name
        assert recording.normalised_return == -22 / 60, name


def test_trains_alone_pass_through_each_other():
    recording = played("alone", line((2, EAST, 6), (3, WEST, 0)))
    assert recording.arrived_at.tolist() == [4, 3]
    assert recording.rewards.tolist() == [[-1, -1]] * 3 + [[-1, 0], [1, 1]]
    assert recording.decisions.times.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4]
    single = line((2, EAST, 6))
    alone, real = played("alone", single), played("shortest-path", single)
    for name in ("rewards", "arrived_at"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(real, name), name)
    assert digest_of(alone.decisions) == digest_of(real.decisions)
