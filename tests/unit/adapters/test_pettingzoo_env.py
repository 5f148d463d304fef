"""The PettingZoo environment: its library's own tests, and that it plays as our worlds do."""

from itertools import count

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from pettingzoo.test import parallel_api_test, parallel_seed_test

from adapters.pettingzoo_env import TrainsEnv
from common.levels.held_out import is_held_out
from common.levels.supply import LevelSupply
from common.rail.compiled.world import CompiledWorld
from common.rail.flatland_world import FlatlandWorld
from common.rail.play import Decision, Stage
from common.seeding import stream_key, training_level_seed, uniform


def choose(observation, step, train):
    """Mostly forward, else anything; it depends on all that it is given."""
    draw = uniform(stream_key(step, train, observation.tobytes().hex()), 0)
    return 2 if draw < 0.8 else int((draw - 0.8) * 25)


@pytest.mark.parametrize("difficulty", ["easy", "hard"])
def test_it_passes_pettingzoos_test_of_the_interface(difficulty):
    parallel_api_test(TrainsEnv(difficulty), num_cycles=1000)


def test_it_passes_pettingzoos_test_of_seeds():
    parallel_seed_test(lambda: TrainsEnv("medium"), num_cycles=100)


@pytest.mark.parametrize(
    ("difficulty", "world"),
    [("easy", FlatlandWorld(1, 7)), ("hard", FlatlandWorld(1, 7)), ("hard", CompiledWorld(1, 7))],
    ids=["flatland-easy", "flatland-hard", "compiled-hard"],
)
def test_it_plays_a_level_as_our_actors_do(difficulty, world):
    env = TrainsEnv(difficulty)
    seen, infos = env.reset(seed=7)
    stage = Stage(world)
    stage.begin(env.level, np.zeros(0, np.int8), 0)
    recording = stage.advance(lambda *seen: Decision(choose(*seen)), np.zeros((env.level.n_trains, 0), np.float32))
    rewards, arrived_at, decisions = [], np.full(env.level.n_trains, -1), []
    for step in count():
        actions = {}
        for train, agent in enumerate(env.possible_agents):
            if agent in env.agents and infos[agent]["deciding"]:
                actions[agent] = choose(seen[agent], step, train)
                decisions.append((step, train, actions[agent], seen[agent]))
        seen, given, terminated, truncated, infos = env.step(actions)
        rewards.append(next(iter(infos.values()))["team_reward"])
        for train, agent in enumerate(env.possible_agents):
            if terminated.get(agent):
                arrived_at[train] = step
            if agent in given:
                assert given[agent] == recording.rewards[step][train]
            if truncated.get(agent):
                assert not terminated[agent]
                np.testing.assert_array_equal(seen[agent], recording.final_observations[train])
        if not env.agents:
            break
    assert step + 1 == recording.last_step
    assert rewards == [row.sum() for row in recording.rewards]
    np.testing.assert_array_equal(arrived_at, recording.arrived_at)
    assert [decision[:3] for decision in decisions] == list(
        zip(recording.decisions.times, recording.decisions.trains, recording.decisions.actions, strict=True)
    )
    np.testing.assert_array_equal([decision[3] for decision in decisions], recording.decisions.observations)


def test_seeds_name_the_levels_of_a_run_and_each_reset_goes_on_to_the_next():
    env, again = TrainsEnv("easy"), TrainsEnv("easy")
    hashes = []
    for seed in (3, None, None):
        env.reset(seed=seed)
        again.reset(seed=seed)
        assert env.level.content_hash == again.level.content_hash
        assert not is_held_out(env.level)
        hashes.append(env.level.content_hash)
    assert len(set(hashes)) == 3
    assert LevelSupply().training("easy", training_level_seed(3, 2)).content_hash == hashes[2]
    TrainsEnv("easy").reset()  # without any seed


def test_a_reset_may_ask_for_a_difficulty_or_a_level():
    env = TrainsEnv("medium")
    seen, _ = env.reset(seed=1, options={"difficulty": "easy"})
    assert list(seen) == env.agents == ["train_0", "train_1", "train_2"]
    level = LevelSupply().evaluation("easy", 0)
    env.reset(options={"level": level})
    assert env.level is level
    with pytest.raises(ValueError, match="7 trains, but an environment for 5: make it for a higher difficulty"):
        env.reset(options={"difficulty": "hard"})
    with pytest.raises(ValueError, match="unknown difficulty meduim: did you mean medium"):
        env.reset(options={"difficulty": "meduim"})


def test_masks_leave_trains_that_do_not_decide_nothing_to_choose():
    env = TrainsEnv("easy", decisions="cells")
    _, infos = env.reset(seed=2)
    kinds = set()
    for _ in range(40):
        for info in infos.values():
            kinds.add(info["deciding"])
            assert info["action_mask"].tolist() == ([1] * 5 if info["deciding"] else [0, 0, 1, 0, 0])
        *_, infos = env.step(dict.fromkeys(env.agents, 2))
    assert kinds == {False, True}


def test_what_is_no_action_is_refused():
    env = TrainsEnv("easy")
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step({})
    env.reset(seed=1)
    with pytest.raises(ValueError, match="train_0 decides, and there is no action for it"):
        env.step({})
    with pytest.raises(ValueError, match="train_1 has action 5: choose 0 to 4"):
        env.step({"train_0": 2, "train_1": 5, "train_2": 2})


def test_depth_and_decisions_are_what_was_asked_for():
    env = TrainsEnv("easy", depth=1, decisions="always")
    seen, _ = env.reset(seed=1)
    assert env.observation_space("train_0").shape == (60,)
    assert all(env.observation_space(agent).contains(seen[agent]) for agent in env.agents)
    forwards = [info["deciding"] for _ in range(5) for info in env.step(dict.fromkeys(env.agents, 2))[4].values()]
    assert all(forwards)
    with pytest.raises(ValueError, match="unknown decisions cell: did you mean cells"):
        TrainsEnv("easy", decisions="cell")
    with pytest.raises(ValueError, match="unknown difficulty simple"):
        TrainsEnv("simple")
