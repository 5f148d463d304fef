"""The world on flatland-rl: rewards, arrivals, decisions, independence of slots."""

import random

import numpy as np
import pytest

from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.rail.decisions import decision_cells
from railctl.common.rail.flatland_world import FlatlandEpisode, FlatlandWorld
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, MOVE_LEFT, STOP_MOVING, World

EAST, WEST = 1, 3
ALONG = 0x0401
WEST_END, EAST_END = 0x0004, 0x0100


def line(*trains: tuple[int, int, int]) -> Level:
    """A line of seven cells; each train is start column, heading, target column."""
    return Level(
        grid=np.array([[WEST_END, ALONG, ALONG, ALONG, ALONG, ALONG, EAST_END]], dtype=np.uint16),
        starts=np.array([[0, start, heading] for start, heading, _ in trains], dtype=np.int32),
        targets=np.array([[0, target] for _, _, target in trains], dtype=np.int32),
        max_steps=20,
    )


def world_of(*levels: Level, max_trains: int = 7) -> FlatlandWorld:
    world = FlatlandWorld(len(levels), max_trains)
    for slot, level in enumerate(levels):
        world.load(slot, level)
    return world


def all_do(world: World, action: int) -> np.ndarray:
    return np.full((world.slots, world.max_trains), action, np.int8)


def random_play(world: World, slot: int, seed: int, steps: int) -> list[bytes]:
    """What happens in a slot while all slots act at random, each from its own stream."""
    streams = [np.random.default_rng([seed, other]) for other in range(world.slots)]
    events = []
    for _ in range(steps):
        deciding = np.flatnonzero(world.deciding()[slot])
        seen = [world.observe(slot, train) for train in deciding]
        actions = np.array([stream.integers(5, size=world.max_trains) for stream in streams], np.int8)
        rewards = world.step(actions)
        events += [deciding.tobytes(), *(o.tobytes() for o in seen), rewards[slot].tobytes()]
        events += [world.arrived()[slot].tobytes(), world.over()[slot].tobytes()]
    return events


def test_a_lone_train_is_paid_for_its_arrival():
    world = world_of(line((1, EAST, 5)), max_trains=2)
    assert world.deciding().tolist() == [[True, False]]
    rewards = [world.step(all_do(world, MOVE_FORWARD))[0].tolist() for _ in range(4)]
    assert rewards == [[-1, 0]] * 4  # one step to enter the map
    assert not world.deciding().any()  # no switch on the way
    assert not world.over()[0]
    assert world.step(all_do(world, STOP_MOVING))[0].tolist() == [1, 0]  # 0 for the train, 1 for all
    assert world.arrived().tolist() == [[True, False]]
    assert world.over().tolist() == [True]
    assert not world.step(all_do(world, MOVE_FORWARD)).any()


def test_arrival_ends_a_trains_rewards_and_the_last_one_pays_all():
    world = world_of(line((3, EAST, 5), (2, EAST, 6)), max_trains=2)
    rewards = [world.step(all_do(world, MOVE_FORWARD))[0].tolist() for _ in range(5)]
    assert rewards == [[-1, -1], [-1, -1], [0, -1], [0, -1], [1, 1]]


def test_the_step_limit_is_no_arrival_and_trains_see_to_the_end():
    world = world_of(line((1, EAST, 5)))
    total = sum(world.step(all_do(world, DO_NOTHING)).sum() for _ in range(20))
    assert total == -20
    assert world.over()[0]
    assert not world.arrived().any()
    assert not world.deciding().any()
    assert world.observe(0, 0).any()


def test_a_blocked_train_is_committed_and_does_not_decide():
    episode = FlatlandEpisode(line((3, WEST, 1), (2, EAST, 5)))
    episode.step([MOVE_FORWARD, MOVE_FORWARD])
    episode.step([MOVE_FORWARD, STOP_MOVING])
    assert episode.committed() == [True, False]
    episode.step([STOP_MOVING, DO_NOTHING])
    assert episode.committed() == [True, False]
    assert episode.configurations() == [(0, 3, WEST), (0, 2, EAST)]


def test_a_standing_train_stays_on_do_nothing_and_a_moving_one_drives_on():
    episode = FlatlandEpisode(line((1, EAST, 5)))
    places = []
    for action in (MOVE_LEFT, DO_NOTHING, MOVE_FORWARD, DO_NOTHING, STOP_MOVING, DO_NOTHING):
        episode.step([action])
        places.append(episode.configurations()[0][1])
    assert places == [1, 1, 2, 3, 3, 3]


def test_trains_decide_before_departure_and_on_decision_cells_only():
    level = generate("hard", 11)
    table, world, episode = decision_cells(level.grid), world_of(level), FlatlandEpisode(level)
    rng = np.random.default_rng(0)
    for _ in range(150):
        for train, here in enumerate(episode.configurations()):
            expected = not episode.arrived()[train] if here is None else table[here] and not episode.committed()[train]
            assert world.deciding()[0, train] == expected
        actions = rng.integers(5, size=(1, 7)).astype(np.int8)
        episode.step(np.where(world.deciding()[0], actions[0], MOVE_FORWARD).tolist())
        world.step(actions)


def test_slots_are_worlds_of_their_own():
    easy, hard = generate("easy", 2), generate("hard", 3)
    both = world_of(easy, hard)
    alone = world_of(hard, hard)  # the same place in the batch, other company
    assert random_play(both, 1, seed=5, steps=80) == random_play(alone, 1, seed=5, steps=80)
    both, alone = world_of(easy, hard), world_of(easy)
    assert random_play(both, 0, seed=6, steps=80) == random_play(alone, 0, seed=6, steps=80)
    assert not both.deciding()[0, 3:].any()


def test_a_level_replays_whatever_the_slot_held_before():
    world = world_of(generate("hard", 1))
    first = random_play(world, 0, seed=1, steps=60)
    world.load(0, line((1, EAST, 5)))
    random_play(world, 0, seed=2, steps=5)
    world.load(0, generate("hard", 1))
    assert random_play(world, 0, seed=1, steps=60) == first


def test_nothing_loaded_is_over_and_cannot_be_seen():
    world = FlatlandWorld(2, 3)
    assert world.over().all()
    assert not world.step(all_do(world, MOVE_FORWARD)).any()
    with pytest.raises(ValueError, match="slot 1 was never loaded"):
        world.observe(1, 0)


def test_a_level_with_too_many_trains_is_refused():
    with pytest.raises(ValueError, match="7 trains, the world has room for 3"):
        FlatlandWorld(1, 3).load(0, generate("hard", 1))


def test_the_interpreters_generator_is_left_alone():
    random.seed(3)
    state = random.getstate()
    random_play(world_of(generate("easy", 1)), 0, seed=1, steps=5)
    assert random.getstate() == state
