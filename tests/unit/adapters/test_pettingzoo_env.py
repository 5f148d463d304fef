"""The PettingZoo environment: its library's own tests, and that it plays as our worlds do."""

import pickle
from itertools import count

import numpy as np
import pytest
import yaml
from gymnasium.error import ResetNeeded
from pettingzoo.test import parallel_api_test, parallel_seed_test
from pettingzoo.utils.conversions import parallel_to_aec
from rush_levels import RUSH, rush_level

from railctl.adapters.pettingzoo_env import TrainsEnv
from railctl.common.levels.distributions import shipped
from railctl.common.levels.held_out import is_held_out
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.player import compiled_world, conditions
from railctl.common.rail.flatland_world import FlatlandWorld
from railctl.common.rail.play import Decision, Stage
from railctl.common.seeding import (
    stream_key,
    training_distribution,
    training_level_seed,
    training_malfunction_seed,
    uniform,
)
from railctl.common.strict import ConfigError
from railctl.common.world import WorldSpec

OBSERVATIONS = {
    "tree": {"kind": "tree", "depth": 1},
    "plain": {"kind": "tree", "depth": 3, "features": "plain", "conflicts": "repaired"},
    "global": {"kind": "global"},
    "local": {"kind": "local", "radius": 2},
}
REWARDS = {"study": {"kind": "study"}, "delay": {"kind": "delay"}, "shaped": {"kind": "shaped", "progress": 0.5}}


def world_of(names=("easy", "rush"), **parts):
    known = {name: levels.model_dump(mode="json") for name, levels in shipped().items()} | {"rush": RUSH}
    return WorldSpec.model_validate({"levels": {name: known[name] for name in names}} | parts)


def choose(observation, step, train, allowed=31, label=-1):
    """Mostly forward, else anything that is allowed; it depends on all that it is given."""
    draw = uniform(stream_key(step, train, observation.tobytes().hex()), 0)
    action = 2 if draw < 0.8 else int((draw - 0.8) * 25)
    return action if allowed >> action & 1 else allowed.bit_length() - 1


@pytest.mark.parametrize("name", ["easy", "rush"])
@pytest.mark.filterwarnings("ignore:.*reset knows no option 'options'")
@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_it_passes_pettingzoos_test_of_the_interface(name, kind):
    parallel_api_test(TrainsEnv(name, world=world_of([name], observation=OBSERVATIONS[kind])), num_cycles=300)


@pytest.mark.parametrize("name", ["medium", "rush"])
def test_it_passes_pettingzoos_test_of_seeds(name):
    parallel_seed_test(lambda: TrainsEnv(name, world=world_of([name])), num_cycles=100)


def play_as(env, seen, infos, stage):
    """Play the environment's episode in both; compare all there is."""
    malfunction_seed = training_malfunction_seed(7, 0)
    stage.begin(env.level, malfunction_seed, np.zeros(0, np.int8), 0)
    recording = stage.advance(lambda *seen: Decision(choose(*seen)), np.zeros((env.level.n_trains, 0), np.float32))
    rewards, arrived_at, decisions = [], np.full(env.level.n_trains, -1), []
    for step in count():
        actions = {}
        for train, agent in enumerate(env.possible_agents):
            if agent in env.agents and infos[agent]["deciding"]:
                allowed = int((infos[agent]["action_mask"] << np.arange(5)).sum())
                actions[agent] = choose(seen[agent], step, train, allowed)
                decisions.append((step, train, actions[agent], seen[agent]))
        seen, given, terminated, truncated, infos = env.step(actions)
        assert not any(info["refused"] for info in infos.values())
        rewards.append(next(iter(infos.values()))["team_reward"])
        for train, agent in enumerate(env.possible_agents):
            if terminated.get(agent):
                arrived_at[train] = step
                assert not seen[agent].any()
            if agent in given:
                assert given[agent] == recording.rewards[step][train]
            if truncated.get(agent):
                assert not terminated[agent]
                np.testing.assert_array_equal(seen[agent], recording.final_observations[train])
        if not env.agents:
            break
        assert "normalised_return" not in next(iter(infos.values()))
    assert step + 1 == recording.last_step
    assert rewards == pytest.approx([row.sum() for row in recording.rewards])
    np.testing.assert_array_equal(arrived_at, recording.arrived_at)
    assert [decision[0] for decision in decisions] == recording.decisions.times.tolist()
    assert [decision[1] for decision in decisions] == recording.decisions.trains.tolist()
    assert [decision[2] for decision in decisions] == recording.decisions.actions.tolist()
    np.testing.assert_array_equal([decision[3] for decision in decisions], recording.decisions.observations)
    info = next(iter(infos.values()))
    assert info["normalised_return"] == recording.normalised_return
    assert info.get("score") == recording.score
    return recording


@pytest.mark.parametrize("engine", ["compiled", "flatland"])
@pytest.mark.parametrize(
    ("name", "observation", "reward", "decisions", "interlocking"),
    [
        ("easy", "tree", "study", "cells", "off"),
        ("easy", "tree", "study", "cells", "valid"),
        ("hard", "plain", "shaped", "legacy", "off"),
        ("rush", "tree", "delay", "always", "off"),
        ("rush", "tree", "delay", "always", "valid"),
        ("rush", "plain", "study", "cells", "off"),
        ("rush", "global", "shaped", "cells", "off"),
        ("rush", "local", "study", "legacy", "off"),
    ],
)
def test_it_plays_a_level_as_our_actors_do(engine, name, observation, reward, decisions, interlocking):
    parts = {"observation": OBSERVATIONS[observation], "reward": REWARDS[reward], "decisions": decisions}
    world = world_of([name], **parts, interlocking=interlocking)
    env, rules = TrainsEnv(world=world), world.levels[name].rules
    seen, infos = env.reset(seed=7)
    trains = env.level.n_trains
    made = {"compiled": compiled_world, "flatland": lambda *told: FlatlandWorld(1, trains, **conditions(*told[:2]))}
    recording = play_as(env, seen, infos, Stage(made[engine](world, rules, trains)))
    assert env.level.content_hash == LevelSupply(world.levels).training(name, training_level_seed(7, 0)).content_hash
    assert (recording.score is None) == (rules == "legacy")


def test_it_plays_the_run_file_that_it_is_given(tmp_path):
    text = {
        "algorithm": "ppo",
        "levels": {"rush": RUSH},
        "mix": {"easy": 0.5, "rush": 0.5},
        "observation": "global",
        "decisions": "always",
        "reward": {"kind": "delay"},
        "episodes": 3,
    }
    path = tmp_path / "run.yaml"
    path.write_text(yaml.safe_dump(text))
    env = TrainsEnv(run_file=path)
    assert env.world == world_of(observation={"kind": "global"}, decisions="always", reward={"kind": "delay"})
    assert env.observation_space("train_0").shape == (25 * 25 * 23,)
    assert len(env.possible_agents) == RUSH["trains"]
    names = []
    for episode in range(4):
        env.reset(seed=2 if episode == 0 else None)
        names.append(training_distribution(text["mix"], 2, episode))
        expected = LevelSupply(env.world.levels).training(names[-1], training_level_seed(2, episode))
        assert env.level.content_hash == expected.content_hash
    assert set(names) == {"easy", "rush"}
    env = TrainsEnv("easy", run_file=str(path))
    env.reset(seed=2)
    assert (env.level.n_trains, env.level.schedule, len(env.possible_agents)) == (3, None, 3)
    path.write_text("level: medium\n")
    assert len(TrainsEnv(run_file=path).possible_agents) == 5


def test_what_a_run_file_cannot_say_is_one_line(tmp_path):
    path = tmp_path / "run.yaml"
    for text, message in [
        ("- 1", "holds no keys"),
        ("a: [", "is not YAML"),
        ("mix: 1", "mix: input should be a valid dictionary, not 1"),
        ("mix: {eassy: 1}", "unknown level 'eassy': did you mean easy"),
        ("observation: tee", "observation.kind: unknown 'tee': known are"),
        ("decisions: cell", "decisions: input should be 'cells'"),
    ]:
        path.write_text(text)
        with pytest.raises(ConfigError, match=message) as caught:
            TrainsEnv(run_file=path)
        assert "\n" not in str(caught.value)
    with pytest.raises(
        ConfigError, match=r"no\.yaml cannot be read: No such file or directory: give an existing run file"
    ):
        TrainsEnv(run_file=tmp_path / "no.yaml")


def test_arguments_that_contradict_each_other_are_refused(tmp_path):
    world = world_of()
    with pytest.raises(ConfigError, match="run_file and world are both given: leave one out"):
        TrainsEnv(world=world, run_file=tmp_path)
    with pytest.raises(ConfigError, match="depth 2: the world says it already, leave it out"):
        TrainsEnv(world=world, depth=2)
    with pytest.raises(ConfigError, match="unknown level 'rusk': did you mean rush"):
        TrainsEnv("rusk", world=world)
    with pytest.raises(ConfigError, match="unknown render_mode 'rgb': did you mean rgb_array"):
        TrainsEnv(render_mode="rgb")


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


def test_a_reset_may_ask_for_levels_or_a_level():
    env = TrainsEnv("medium")
    for option in ("levels", "difficulty"):
        seen, _ = env.reset(seed=1, options={option: "easy"})
        assert list(seen) == env.agents == ["train_0", "train_1", "train_2"]
    level = LevelSupply().evaluation("easy", 0)
    env.reset(options={"level": level})
    assert env.level is level
    with pytest.raises(ValueError, match="7 trains, but an environment for 5: make it for levels with more trains"):
        env.reset(options={"levels": "hard"})
    with pytest.raises(ValueError, match="unknown level 'meduim': did you mean medium"):
        env.reset(options={"levels": "meduim"})


def test_a_level_is_played_under_the_rules_that_fit_it():
    level, plain = rush_level(1), LevelSupply().evaluation("easy", 0)
    both, old, new = (TrainsEnv(world=world_of(names)) for names in (("easy", "rush"), ["medium"], ["rush"]))
    for env, given, has_score in [(both, level, True), (both, plain, False), (new, level, True), (old, plain, False)]:
        env.reset(seed=1, options={"level": given})
        while env.agents:
            *_, infos = env.step(dict.fromkeys(env.agents, 2))
        assert ("score" in next(iter(infos.values()))) is has_score
    with pytest.raises(ValueError, match=r"the rules of 2\.2\.2 know speed 1 only"):
        old.reset(options={"level": level})
    with pytest.raises(ValueError, match="the level has 25x25 cells, the world has room for 24x22"):
        new.reset(options={"level": plain})


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


def test_an_action_that_is_not_granted_stops_a_train():
    first, second = (TrainsEnv(world=world_of(["hard"], interlocking="valid")) for _ in range(2))
    _, infos = first.reset(seed=2)
    second.reset(seed=2)
    refused = set()
    for step in range(60):
        wanted = {agent: (step + train) % 5 for train, agent in enumerate(first.agents)}
        denied = {
            agent for agent in wanted if infos[agent]["deciding"] and not infos[agent]["action_mask"][wanted[agent]]
        }
        *ours, infos = first.step(wanted)
        *theirs, others = second.step(wanted | dict.fromkeys(denied, 4))
        np.testing.assert_equal(ours, theirs)
        assert {agent for agent, info in infos.items() if info["refused"]} == denied
        assert not any(info["refused"] for info in others.values())
        refused |= denied
    assert len(refused) > 3


def test_what_is_no_action_is_refused():
    env = TrainsEnv("easy")
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step({})
    env.reset(seed=1)
    with pytest.raises(ValueError, match="train_0 decides, and there is no action for it"):
        env.step({})
    with pytest.raises(ValueError, match="train_1 has action 5: choose 0 to 4"):
        env.step({"train_0": 2, "train_1": 5, "train_2": 2})
    with pytest.raises(ValueError, match="actions None: give a dictionary, an action by agent"):
        env.step(None)


def test_after_the_last_step_there_is_nothing_and_nobody():
    env = TrainsEnv("easy")
    env.reset(seed=1)
    while env.agents:
        env.step(dict.fromkeys(env.agents, 2))
    for _ in range(2):
        assert env.step({}) == ({}, {}, {}, {}, {})
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step({"train_0": 2})
    env.reset()
    assert len(env.agents) == 3


def test_wrappers_may_keep_trains_that_have_arrived_as_agents_that_see_nothing():
    """What SuperSuit's `black_death_v3` and its vector environments do, which are not installed here."""
    env = TrainsEnv("easy")
    spaces = {agent: env.observation_space(agent) for agent in env.possible_agents}
    assert len({id(space) for space in spaces.values()}) == 1
    seen, _ = env.reset(seed=1)
    agents, lived, rows = list(env.agents), [], [seen]
    while True:
        active = dict.fromkeys(env.agents, 2)
        lived.append(len(active))
        seen, rewards, terminated, truncated, _ = env.step(active)
        rows.append({agent: seen.get(agent, np.zeros_like(spaces[agent].low)) for agent in agents})
        assert all(env.observation_space(agent) is spaces[agent] for agent in agents)
        assert all(spaces[agent].contains(row) for agent, row in rows[-1].items())
        if all(terminated[agent] and truncated[agent] for agent in terminated):  # so of none
            break
    assert rewards == {}
    assert lived[-1] == 0
    assert set(lived) > {0, 3}  # some arrived before others
    np.testing.assert_array_equal([rows[-1][agent] for agent in agents], 0)
    env.reset()
    assert env.agents == agents


def test_copies_go_on_alike_and_independently():
    env = TrainsEnv("rush", world=world_of(["rush"]))
    env.reset(seed=5)
    copy = pickle.loads(pickle.dumps(env))  # noqa: S301  (as SuperSuit copies environments)
    for played in (env, copy):
        played.step(dict.fromkeys(played.agents, 2))
    before, _, _, _, _ = env.step(dict.fromkeys(env.agents, 2))
    after, _, _, _, _ = copy.step(dict.fromkeys(copy.agents, 2))
    for agent, row in before.items():
        np.testing.assert_array_equal(row, after[agent])


def test_depth_and_decisions_are_what_was_asked_for():
    env = TrainsEnv("easy", depth=1, decisions="always")
    seen, _ = env.reset(seed=1)
    assert env.observation_space("train_0").shape == (60,)
    assert all(env.observation_space(agent).contains(seen[agent]) for agent in env.agents)
    forwards = [info["deciding"] for _ in range(5) for info in env.step(dict.fromkeys(env.agents, 2))[4].values()]
    assert all(forwards)
    with pytest.raises(ValueError, match="decisions: input should be 'cells'"):
        TrainsEnv("easy", decisions="cell")
    with pytest.raises(ValueError, match="unknown level 'simple'"):
        TrainsEnv("simple")


def test_it_serves_as_an_aec_environment():
    env = parallel_to_aec(TrainsEnv("easy"))
    env.reset(seed=1)
    for agent in env.agent_iter(30):
        *_, info = env.last()
        env.step(env.action_space(agent).sample(info["action_mask"]))
    assert env.num_agents == 3


@pytest.mark.parametrize("seed", ["a", -1, 1.5, True, 2**31, [1]])
def test_a_seed_is_a_whole_number_that_a_run_can_have(seed):
    with pytest.raises(ValueError, match="give a whole number from 0 to 2"):
        TrainsEnv("easy").reset(seed=seed)


@pytest.mark.parametrize("action", [1.5, 2.0, "2", True, -1, 5, np.float32(1), [2], np.array([2])])
def test_an_action_is_a_whole_number(action):
    env = TrainsEnv("easy", decisions="always")
    env.reset(seed=1)
    with pytest.raises(ValueError, match=r"train_1 has action .*: choose 0 to 4"):
        env.step({"train_0": 2, "train_1": action, "train_2": 2})
    env.step({"train_0": np.int64(2), "train_1": np.array(2), "train_2": np.int8(2)})


def test_what_is_no_agent_has_no_action():
    env = TrainsEnv("easy", decisions="always")
    env.reset(seed=1)
    with pytest.raises(ValueError, match="there is no agent 'train_3': did you mean train_"):
        env.step(dict.fromkeys([*env.agents, "train_3"], 2))


def test_options_that_nobody_knows_are_warned_of_and_a_level_is_one():
    env = TrainsEnv("easy")
    with pytest.warns(UserWarning, match="reset knows no option 'lvls': known are difficulty, level, levels"):
        env.reset(seed=1, options={"lvls": "hard"})
    with pytest.raises(ValueError, match="level 'easy' is no Level"):
        env.reset(seed=1, options={"level": "easy"})
