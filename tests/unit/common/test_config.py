"""Wrong configurations end in one line that names field, value and remedy; right ones mean what they say."""

import copy

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from common.config import parse_config
from common.rules.values import ExplorationConfig
from common.strict import ConfigError, describe, nearest

DQN = {"learning_rate": 0.001, "batch_size": 8, "learn_every_steps": 4}


def plain(changes=()):
    """A valid configuration as plain data, with values laid over it by dotted key."""
    data = {
        "algorithm": "dddqn",
        "mix": {"easy": 1.0},
        "episodes": 10,
        "network": {"hidden": [16, 16]},
        "dqn": DQN,
        "replay": {"capacity": 100},
        "rule": "dqn",
        "cluster": {"actors": {"easy": 1}},
    }
    data = copy.deepcopy(data)
    for key, value in dict(changes).items():
        *path, last = key.split(".")
        section = data
        for part in path:
            section = section.setdefault(part, {})
        section[last] = value
    return data


def complaint(data):
    with pytest.raises(ConfigError) as caught:
        parse_config(data)
    text = str(caught.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("episodes", 0, "episodes: input should be greater than or equal to 1, not 0"),
        ("episodes", 10_000_001, "episodes: input should be less than or equal to 10000000, not 10000001"),
        (
            "episodes",
            "many",
            "episodes: input should be a valid integer, unable to parse string as an integer, not 'many'",
        ),
        (
            "episodes",
            2.5,
            "episodes: input should be a valid integer, got a number with a fractional part, not 2.5",
        ),
        ("seed", -1, "seed: input should be greater than or equal to 0, not -1"),
        ("seed", 2**31, "seed: input should be less than 2147483648, not 2147483648"),
        ("lag", -1, "lag: input should be greater than or equal to 0, not -1"),
        ("lag", 1025, "lag: input should be less than or equal to 1024, not 1025"),
        ("engine", "stone", "engine: input should be 'compiled' or 'flatland', not 'stone'"),
        ("discount", 0, "discount: input should be greater than 0, not 0"),
        ("discount", 1.5, "discount: input should be less than or equal to 1, not 1.5"),
        ("network.hidden", [0], "network.hidden.0: input should be greater than or equal to 1, not 0"),
        ("network.hidden", "wide", "network.hidden: input should be a valid tuple, not 'wide'"),
        ("dqn.learning_rate", 0, "dqn.learning_rate: input should be greater than 0, not 0"),
        ("dqn.learning_rate", float("inf"), "dqn.learning_rate: input should be a finite number, not inf"),
        ("dqn.batch_size", 0, "dqn.batch_size: input should be greater than or equal to 1, not 0"),
        ("dqn.batch_size", 101, "dqn.batch_size 101 exceeds replay.capacity 100: make one fit the other"),
        ("dqn.target_tau", 0, "dqn.target_tau: input should be greater than 0, not 0"),
        ("dqn.double", True, "dqn: double needs a target network: set target_tau"),
        (
            "exploration.epsilon_start",
            1.1,
            "exploration.epsilon_start: input should be less than or equal to 1, not 1.1",
        ),
        ("exploration.epsilon_end", 0, "exploration.epsilon_end: input should be greater than 0, not 0"),
        ("exploration.decay_share", 2, "exploration.decay_share: input should be less than or equal to 1, not 2"),
        (
            "evaluation.every_episodes",
            0,
            "evaluation.every_episodes: input should be greater than or equal to 1, not 0",
        ),
        ("evaluation.levels", 0, "evaluation.levels: input should be greater than or equal to 1, not 0"),
        ("evaluation.mode", "best", "evaluation.mode: input should be 'greedy' or 'sample', not 'best'"),
        (
            "evaluation.mode",
            "sample",
            "evaluation.mode sample: action values give no probabilities to sample, make it greedy",
        ),
        (
            "network.kind",
            "actor-critic",
            "network.kind is actor-critic, which dqn cannot train: make it plain, dueling or recurrent",
        ),
        (
            "ppo",
            {"learning_rate": 1, "epochs": 1},
            "a run learns either action values or a policy: give dqn or ppo, and not both",
        ),
        ("fragment_steps", 0, "fragment_steps: input should be greater than or equal to 1, not 0"),
        ("cluster.cores", 0, "cluster.cores: input should be greater than or equal to 1, not 0"),
        ("cluster.port", 65536, "cluster.port: input should be less than or equal to 65535, not 65536"),
        ("cluster.hang_timeout_s", 0, "cluster.hang_timeout_s: input should be greater than or equal to 5, not 0"),
        ("cluster.actors.easy", 257, "cluster.actors.easy: input should be less than or equal to 256, not 257"),
        (
            "cluster.actors.esy",
            1,
            "cluster.actors.esy: input should be 'easy', 'medium', 'hard' or 'any', not 'esy'",
        ),
        ("mix.easy", 0, "mix.easy: input should be greater than 0, not 0"),
        ("mix.esy", 1, "mix.esy: input should be 'easy', 'medium' or 'hard', not 'esy'"),
        ("mix", "easy", "mix: input should be a valid dictionary, not 'easy'"),
        ("dqn", 5, "dqn: input should be a valid dictionary or instance of DqnConfig, not 5"),
    ],
)
def test_a_wrong_value_is_named_with_its_field_and_its_bounds(key, value, text):
    assert complaint(plain({key: value})) == text


@pytest.mark.parametrize(
    ("key", "start"),
    [
        ("episode", "unknown key episode: did you mean episodes? known are algorithm, cluster, discount, dqn, "),
        ("dqn.batchsize", "unknown key dqn.batchsize: did you mean batch_size? known are batch_size, double, "),
        ("exploration.decay", "unknown key exploration.decay: did you mean decay_share? known are decay_share, "),
        ("cluster.xyzzy", "unknown key cluster.xyzzy: known are actors, cores, "),
    ],
)
def test_an_unknown_key_is_an_error_that_names_the_nearest(key, start):
    assert complaint(plain({key: 1})).startswith(start)


@pytest.mark.parametrize("key", ["algorithm", "mix", "episodes", "network", "dqn", "cluster"])
def test_a_missing_section_is_named(key):
    data = plain()
    del data[key]
    wanted = "a run learns either action values or a policy: give dqn or ppo, and not both"
    assert complaint(data) == (wanted if key == "dqn" else f"{key} is missing: give it a value")


def test_a_missing_value_is_named_with_its_section():
    data = plain()
    del data["dqn"]["batch_size"]
    assert complaint(data) == "dqn.batch_size is missing: give it a value"


def test_a_key_that_is_no_text_is_named():
    assert complaint(plain() | {5: 1}) == "5: keys should be strings, not 5"


def test_nearest_lists_what_is_known_even_without_a_near_one():
    assert nearest("hrad", ["hard", "easy"]) == ": did you mean hard? known are easy, hard"
    assert nearest("xyz", ["hard", "easy"]) == ": known are easy, hard"


@pytest.mark.parametrize(
    ("mix", "actors", "text"),
    [
        ({}, {"any": 1}, "the shares of mix add up to 0: make it 1"),
        ({"easy": 0.5, "hard": 0.25}, {"any": 1}, "the shares of mix add up to 0.75: make it 1"),
        ({"easy": 0.75, "hard": 0.75}, {"any": 1}, "the shares of mix add up to 1.5: make it 1"),
        ({"easy": 1}, {}, "no actors for difficulty easy: add --actors easy=1"),
        ({"easy": 1}, {"easy": 0}, "no actors for difficulty easy: add --actors easy=1"),
        ({"easy": 0.5, "hard": 0.5}, {"easy": 2}, "no actors for difficulty hard: add --actors hard=1"),
        (
            {"easy": 0.5, "hard": 0.5},
            {"any": 1, "medium": 1},
            "actors for difficulty medium, which this run does not have: it has easy, hard",
        ),
        ({"easy": 1}, {"easy": 1, "hard": 1}, "actors for difficulty hard, which this run does not have: it has easy"),
    ],
)
def test_mix_and_actors_must_fit_together(mix, actors, text):
    assert complaint(plain({"mix": mix, "cluster.actors": actors})) == text


@pytest.mark.parametrize(
    ("mix", "actors"),
    [
        ({"easy": 1}, {"any": 1}),
        ({"easy": 1}, {"easy": 1, "hard": 0}),
        ({"easy": 0.1, "medium": 0.2, "hard": 0.7}, {"easy": 1, "medium": 3, "hard": 1}),
        ({"easy": 0.5, "hard": 0.5}, {"any": 1, "hard": 2}),
    ],
)
def test_mixes_that_somebody_serves_are_taken(mix, actors):
    config = parse_config(plain({"mix": mix, "cluster.actors": actors}))
    assert (config.mix, config.cluster.actors) == (mix, actors)


def test_a_configuration_comes_back_from_yaml():
    config = parse_config(plain({"dqn.target_tau": 0.1, "dqn.double": True}))
    assert parse_config(yaml.safe_load(yaml.safe_dump(config.model_dump(mode="json")))) == config


def test_a_configuration_cannot_be_changed():
    config = parse_config(plain())
    with pytest.raises(ValueError, match="frozen"):
        config.episodes = 5
    with pytest.raises(ValueError, match="frozen"):
        config.dqn.batch_size = 5


def test_science_is_everything_but_the_cluster_and_the_engine():
    config = parse_config(plain())
    other_cluster = parse_config(plain({"cluster": {"actors": {"any": 7}, "cores": 1, "snapshot_every_episodes": 3}}))
    assert other_cluster.science == config.science
    assert parse_config(plain({"engine": "flatland"})).science == parse_config(plain({"engine": "compiled"})).science
    assert set(config.science) == set(type(config).model_fields) - {"cluster", "engine"}
    assert parse_config(plain({"seed": 2})).science != config.science
    assert parse_config(plain({"dqn.learning_rate": 0.002})).science != config.science


def test_epsilon_falls_geometrically_over_its_share_of_the_episodes():
    schedule = ExplorationConfig(epsilon_start=0.8, epsilon_end=0.2, decay_share=0.5)
    assert schedule.epsilon(0, 100) == 0.8
    assert schedule.epsilon(25, 100) == pytest.approx(0.4)  # half way, the geometric mean
    assert schedule.epsilon(50, 100) == pytest.approx(0.2)
    assert schedule.epsilon(99, 100) == pytest.approx(0.2)


def test_epsilon_of_a_schedule_that_does_not_fall_is_constant():
    schedule = ExplorationConfig(epsilon_start=0.1, epsilon_end=0.3)
    assert {schedule.epsilon(episode, 10) for episode in range(10)} == {0.1}
    greedy = ExplorationConfig(epsilon_start=0.0, epsilon_end=0.01)
    assert greedy.epsilon(5, 10) == 0.0


def test_epsilon_of_a_very_short_run_starts_at_the_start():
    assert ExplorationConfig(epsilon_start=0.9, epsilon_end=0.01, decay_share=0.01).epsilon(0, 1) == 0.9


@settings(deadline=None, max_examples=50)
@given(
    start=st.floats(0.0, 1.0),
    end=st.floats(1e-6, 1.0),
    share=st.floats(1e-3, 1.0),
    episodes=st.integers(1, 300),
)
def test_epsilon_never_rises_and_stays_between_its_ends(start, end, share, episodes):
    schedule = ExplorationConfig(epsilon_start=start, epsilon_end=end, decay_share=share)
    epsilons = [schedule.epsilon(episode, episodes) for episode in range(episodes)]
    assert epsilons[0] == start
    assert epsilons == sorted(epsilons, reverse=True)
    assert min(epsilons) >= min(start, end) * (1 - 1e-9)


def test_describe_says_the_first_problem_of_any_section():
    with pytest.raises(ValidationError) as caught:
        ExplorationConfig(epsilon_end=0)
    assert describe(caught.value) == "epsilon_end: input should be greater than 0, not 0"


def test_what_does_not_go_together_is_named_with_its_remedy():
    assert complaint(plain({"lag": 1, "fragment_steps": 30})) == (
        "lag 1 needs whole episodes: add --set fragment_steps=null"
    )
    without_replay = plain()
    del without_replay["replay"]
    assert complaint(without_replay) == "dqn.batch_size is drawn from a replay: give replay.capacity"
    policy = plain({"rule": "ppo", "ppo": {"learning_rate": 0.1, "epochs": 2}, "network.kind": "actor-critic"})
    del policy["dqn"], policy["replay"]
    assert parse_config(policy).evaluation.mode == "greedy"
    assert complaint(policy | {"fragment_steps": 5}) == (
        "fragment_steps 5: ppo learns from whole episodes, leave it out"
    )
