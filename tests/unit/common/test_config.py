"""Wrong configurations end in one line that names field, value and remedy; right ones mean what they say."""

import copy
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.config import MOST_CHECKPOINTS, parse_config, upgraded
from railctl.common.levels.distributions import shipped
from railctl.common.rail.observations.table import TreeObservation
from railctl.common.records.checkpoints import MOST_LISTED
from railctl.common.rules.policies import ActorCriticConfig
from railctl.common.rules.replay import PrioritizedReplay, UniformReplay
from railctl.common.rules.values import ExplorationConfig
from railctl.common.strict import ConfigError

SAVED = Path(__file__).parent / "saved"  # by the version before levels had names of their own
RUSH = {"rules": "stock", "size": [30, 40], "trains": 20, "cities": 4, "held_out": 60}
PPO = {
    "algorithm": "ppo",
    "rule": "ppo",
    "mix": {"easy": 1.0},
    "episodes": 10,
    "ppo": {"learning_rate": 0.1, "epochs": 2},
    "cluster": {"actors": {"easy": 1}},
}
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
        ("lag", -1, "lag: -1 is no lag: give a whole number from 0 to 1024, or free"),
        ("lag", 3.5, "lag: 3.5 is no lag: give a whole number from 0 to 1024, or free"),
        ("lag", True, "lag: True is no lag: give a whole number from 0 to 1024, or free"),
        ("lag", "fre", "lag: 'fre' is no lag: give a whole number from 0 to 1024, or free"),
        ("max_staleness", 0, "max_staleness: input should be greater than or equal to 1, not 0"),
        ("max_staleness", 8, "max_staleness 8: lag 0 has no use for it, leave it out"),
        ("lag", 1025, "lag: 1025 is no lag: give a whole number from 0 to 1024, or free"),
        ("engine", "stone", "engine: input should be 'compiled' or 'flatland', not 'stone'"),
        ("discount", 0, "discount: input should be greater than 0, not 0"),
        ("discount", 1.5, "discount: input should be less than or equal to 1, not 1.5"),
        ("network.hidden", [0], "network.hidden.0: input should be greater than or equal to 1, not 0"),
        ("network.hidden", "wide", "network.hidden: input should be a list, not 'wide'"),
        ("dqn.learning_rate", 0, "dqn.learning_rate: input should be greater than 0, not 0"),
        ("dqn.learning_rate", float("inf"), "dqn.learning_rate: input should be a finite number, not inf"),
        ("dqn.batch_size", 0, "dqn.batch_size: input should be greater than or equal to 1, not 0"),
        ("dqn.batch_size", 101, "dqn.batch_size 101 exceeds replay.capacity 100: make one fit the other"),
        ("dqn.target_tau", 0, "dqn.target_tau: input should be greater than 0, not 0"),
        ("dqn.double", True, "dqn: double needs a target network: set target_tau"),
        ("dqn.transitions", "steps", "dqn.transitions: input should be 'span' or 'step', not 'steps'"),
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
            "network.kind: input should be 'plain', 'dueling' or 'dueling-apart', not 'actor-critic'",
        ),
        ("ppo", {"learning_rate": 1, "epochs": 1}, "ppo: rule dqn has no use for it, leave it out"),
        ("sil", {"epochs": 1, "batch_size": 1}, "sil: rule dqn has no use for it, leave it out"),
        (
            "dqn.sequence_decisions",
            3,
            (
                "unknown key dqn.sequence_decisions: known are batch_size, double, learn_every_steps, learning_rate, "
                "target_every, target_tau, transitions"
            ),
        ),
        ("replay.alpha", 0.5, "unknown key replay.alpha: known are capacity, kind"),
        ("replay.kind", "priority", "replay.kind: unknown 'priority': known are 'uniform', 'prioritized'"),
        ("rule", "dqnn", "unknown rule 'dqnn': did you mean dqn? known are dqn, drqn, imitate, ppo, ppor, sil"),
        ("rule", None, "unknown rule None: known are dqn, drqn, imitate, ppo, ppor, sil"),
        ("levels", {}, "levels: input should be a dictionary of at least 1 item, not {}"),
        ("levels", {"rush": RUSH}, "mix: there are no levels easy: known are rush"),
        ("evaluation.levels", 1001, "evaluation.levels: input should be less than or equal to 1000, not 1001"),
        ("fragment_steps", 0, "fragment_steps: input should be greater than or equal to 1, not 0"),
        ("cluster.cores", 0, "cluster.cores: input should be greater than or equal to 1, not 0"),
        ("cluster.hang_timeout_s", 0, "cluster.hang_timeout_s: input should be greater than or equal to 5, not 0"),
        (
            "cluster.listen",
            "tcp/0.0.0.0:1",
            "cluster.listen: 'tcp/0.0.0.0:1' is not tls/HOST:PORT: write for example tls/0.0.0.0:7447",
        ),
        (
            "cluster.listen",
            "tls/0.0.0.0:1",
            "cluster: listen tls/0.0.0.0:1 needs keys: add --keys DIR, as railctl keys create made it",
        ),
        ("cluster.keys", "keys", "cluster: keys keys need an address: add --listen tls/0.0.0.0:7447"),
        ("cluster.keys", "x" * 100, f"cluster: keys {'x' * 77}... need an address: add --listen tls/0.0.0.0:7447"),
        ("cluster.actors.easy", 257, "cluster.actors.easy: input should be less than or equal to 256, not 257"),
        ("cluster.actors.esy", 1, "actors for level esy, which this run does not have: it has easy"),
        (
            "cluster.actors",
            {"easy": 1, "e sy": 1},
            "cluster.actors.e sy: string should match pattern '^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$', not 'e sy'",
        ),
        ("mix.easy", 0, "mix.easy: input should be greater than 0, not 0"),
        ("mix.esy", 1, "unknown level 'esy': did you mean easy? known are easy, hard, medium"),
        ("mix", "easy", "mix: input should be a valid dictionary, not 'easy'"),
        ("mix", {5: 1.0}, "unknown level 5: known are easy, hard, medium"),
        ("mix", None, "mix is missing: give it a value"),
        ("dqn", 5, "dqn: input should be a valid dictionary, not 5"),
        ("cluster", None, "cluster: input should be a valid dictionary, not None"),
    ],
)
def test_a_wrong_value_is_named_with_its_field_and_its_bounds(key, value, text):
    assert complaint(plain({key: value})) == text


@pytest.mark.parametrize(
    ("key", "start"),
    [
        ("episode", "unknown key episode: did you mean episodes? known are algorithm, cluster, decisions, discount, "),
        ("world", "unknown key world: "),  # no key of files
        ("learning", "unknown key learning: "),
        ("dqn.batchsize", "unknown key dqn.batchsize: did you mean batch_size? known are batch_size, double, "),
        ("exploration.decay", "unknown key exploration.decay: did you mean decay_share? known are decay_share, "),
        ("cluster.xyzzy", "unknown key cluster.xyzzy: known are actors, cores, "),
    ],
)
def test_an_unknown_key_is_an_error_that_names_the_nearest(key, start):
    assert complaint(plain({key: 1})).startswith(start)


@pytest.mark.parametrize("key", ["algorithm", "rule", "mix", "episodes", "dqn", "replay", "cluster"])
def test_a_missing_section_is_named(key):
    data = plain()
    del data[key]
    assert complaint(data) == f"{key} is missing: give it a value"


def test_a_missing_value_is_named_with_its_section():
    data = plain()
    del data["dqn"]["batch_size"]
    assert complaint(data) == "dqn.batch_size is missing: give it a value"


def test_a_key_that_is_no_text_is_named():
    assert complaint(plain() | {5: 1}) == "5: keys should be strings, not 5"


@pytest.mark.parametrize(
    ("mix", "actors", "text"),
    [
        ({}, {"any": 1}, "mix names no levels: write for example mix: {easy: 1}"),
        ({"easy": 0.5, "hard": 0.25}, {"any": 1}, "the shares of mix add up to 0.75: make it 1"),
        ({"easy": 0.75, "hard": 0.75}, {"any": 1}, "the shares of mix add up to 1.5: make it 1"),
        ({"easy": 1}, {"hard": 0}, "actors for level hard, which this run does not have: it has easy"),
        ({"easy": 0.5, "hard": 0.5}, {"easy": 2}, "no actors for level hard: add --actors hard=1"),
        (
            {"easy": 0.5, "hard": 0.5},
            {"any": 1, "medium": 1},
            "actors for level medium, which this run does not have: it has easy, hard",
        ),
        ({"easy": 1}, {"easy": 1, "hard": 1}, "actors for level hard, which this run does not have: it has easy"),
    ],
)
def test_mix_and_actors_must_fit_together(mix, actors, text):
    assert complaint(plain({"mix": mix, "cluster.actors": actors})) == text


@pytest.mark.parametrize(
    ("mix", "actors"),
    [
        ({"easy": 1}, {"any": 1}),
        ({"easy": 1}, {}),
        ({"easy": 1}, {"easy": 0, "any": 0}),
        ({"easy": 1}, {"easy": 1, "hard": 0}),
        ({"easy": 0.1, "medium": 0.2, "hard": 0.7}, {"easy": 1, "medium": 3, "hard": 1}),
        ({"easy": 0.5, "hard": 0.5}, {"any": 1, "hard": 2}),
    ],
)
def test_mixes_that_somebody_or_nobody_serves_are_taken(mix, actors):
    config = parse_config(plain({"mix": mix, "cluster.actors": actors}))
    assert (config.mix, config.cluster.actors) == (mix, actors)


def test_what_an_interlocking_allows_on_a_following_step_is_not_known():
    assert parse_config(plain({"dqn.transitions": "step"})).learning.learns_from_following
    assert complaint(plain({"dqn.transitions": "step", "interlocking": "safe"})) == (
        "interlocking safe: dqn.transitions step cannot say what it allows a train that does not decide, make it off, "
        "or dqn.transitions span"
    )


def test_a_configuration_comes_back_from_yaml():
    config = parse_config(plain({"dqn.target_tau": 0.1, "dqn.double": True, "observation": {"depth": 1}}))
    assert parse_config(yaml.safe_load(yaml.safe_dump(config.plain()))) == config


def test_in_files_all_keys_stand_side_by_side():
    assert parse_config(plain()).plain() == {
        **plain(),
        "seed": 1,
        "lag": 0,
        "engine": "compiled",
        "levels": {"easy": shipped()["easy"].model_dump(mode="json")},
        "observation": TreeObservation().model_dump(),
        "decisions": "cells",
        "interlocking": "off",
        "patience": None,
        "reward": {"kind": "study"},
        "network": {"kind": "plain", "hidden": [16, 16]},
        "discount": 0.99,
        "dqn": DQN | {"target_tau": None, "target_every": "update", "double": False, "transitions": "span"},
        "replay": {"kind": "uniform", "capacity": 100},
        "exploration": {"epsilon_start": 0.9, "epsilon_end": 0.01, "decay_share": 0.5},
        "fragment_steps": None,
        "evaluation": {"mode": "greedy", "every_episodes": 100, "levels": 50},
        "cluster": {
            "actors": {"easy": 1},
            "cores": 2,
            "snapshot_every_episodes": 50,
            "hang_timeout_s": 60.0,
            "max_restarts": 5,
            "restart_window_s": 120.0,
            "listen": None,
            "keys": None,
        },
    }


def test_a_configuration_cannot_be_changed():
    config = parse_config(plain())
    with pytest.raises(ValueError, match="frozen"):
        config.episodes = 5
    with pytest.raises(ValueError, match="frozen"):
        config.learning.dqn.batch_size = 5
    with pytest.raises(ValueError, match="frozen"):
        config.world.decisions = "always"


def test_science_is_everything_but_the_cluster_and_the_engine():
    config = parse_config(plain())
    other_cluster = parse_config(
        plain({"cluster": {"actors": {"any": 7}, "cores": 1, "listen": "tls/0.0.0.0:1", "keys": "k"}})
    )
    assert other_cluster.science == config.science
    assert parse_config(plain({"engine": "flatland"})).science == parse_config(plain({"engine": "compiled"})).science
    assert set(config.science) == set(config.plain()) - {"cluster", "engine"}
    for change in ({"seed": 2}, {"dqn.learning_rate": 0.002}, {"decisions": "always"}, {"observation": {"depth": 1}}):
        assert parse_config(plain(change)).science != config.science


def test_levels_that_are_not_given_are_those_that_ship():
    config = parse_config(plain({"mix": {"easy": 0.5, "hard": 0.5}, "cluster.actors": {"any": 1}}))
    assert config.world.levels == {name: shipped()[name] for name in ("easy", "hard")}


def test_levels_of_ones_own_may_be_named():
    config = parse_config(plain({"levels": {"rush": RUSH}, "mix": {"rush": 1}, "cluster": {"actors": {"rush": 2}}}))
    assert config.world.bounds == (30, 40, 20)
    assert config.cluster.actors == {"rush": 2}


def test_no_more_evaluation_levels_than_are_kept_from_training():
    changes = {"levels": {"rush": RUSH}, "mix": {"rush": 1}, "cluster": {"actors": {"rush": 2}}}
    assert parse_config(plain(changes | {"evaluation.levels": 60})).evaluation.levels == 60
    assert complaint(plain(changes | {"evaluation.levels": 61})) == (
        "evaluation.levels 61: rush keeps only 60 from training, use no more"
    )


def test_a_run_has_no_more_checkpoints_than_can_be_listed():
    assert complaint(plain({"episodes": 10_000_000, "evaluation.every_episodes": 1})) == (
        "evaluation.every_episodes 1: 10000000 episodes would have 10000000 checkpoints, and a run has 90000 at most, "
        "make it 112"
    )
    assert parse_config(plain({"episodes": 10_000_000, "evaluation.every_episodes": 112})).episodes == 10_000_000
    assert complaint(plain({"episodes": 180_001, "evaluation.every_episodes": 2})).endswith("at most, make it 3")
    assert parse_config(plain({"episodes": 180_000, "evaluation.every_episodes": 2})).evaluation.every_episodes == 2
    assert MOST_CHECKPOINTS < MOST_LISTED


# Configurations of earlier versions

# Keys of sections that are newer, with values that change nothing:
LATER = {
    "cluster": {"listen": None, "keys": None},
    "dqn": {"target_every": "update", "transitions": "span"},
    "ppo": {"advantages": "standardised", "anchor_weight": 0.0, "returns": "scaled"},
    "replay": {"alpha_end": None},
    "sil": {"returns": "least"},
}


@pytest.mark.parametrize("path", sorted(SAVED.glob("*.yaml")), ids=lambda path: path.stem)
def test_an_earlier_configuration_means_what_it_meant(path):
    saved = yaml.safe_load(path.read_text())
    found = parse_config(saved).plain()
    assert found["levels"] == {name: shipped()[name].model_dump(mode="json") for name in saved["mix"]}
    assert (found["decisions"], found["reward"]) == ("cells", {"kind": "study"})
    assert found["observation"] == TreeObservation().model_dump()
    for key, value in saved.items():
        if isinstance(value, dict) and key in found:
            assert found[key].items() <= (LATER.get(key, {}) | value).items()
        elif key in found:
            assert found[key] == value


def test_what_a_rule_had_no_use_for_is_forgotten():
    ppo, dddqn, drqn, sil = (
        parse_config(yaml.safe_load((SAVED / f"{name}.yaml").read_text()))
        for name in ("ppo-medium", "dddqn-easy", "drqn-medium", "sil-hard")
    )
    kept = {"network", "discount", "ppo", "start_from"}
    assert set(ppo.learning.model_dump()) == kept  # not exploration, nor batch_size
    assert "batch_size" not in ppo.learning.ppo.model_dump()
    assert dddqn.learning.replay == UniformReplay(capacity=50000)
    assert "sequence_decisions" not in dddqn.learning.dqn.model_dump()
    assert drqn.learning.dqn.sequence_decisions == 8
    assert drqn.learning.replay == PrioritizedReplay(capacity=50000, alpha=0.6, beta=0.4)
    assert sil.learning.sil.epochs == 13
    assert sil.learning.network == ActorCriticConfig(hidden=(128, 128))


def test_whole_episodes_of_an_earlier_configuration_stay_whole():
    saved = yaml.safe_load((SAVED / "dddqn-easy.yaml").read_text()) | {"fragment_steps": None}
    assert upgraded(saved)["fragment_steps"] is None  # and is not left to a preset
    assert parse_config(saved).learning.steps_a_fragment is None


def test_configurations_of_this_version_are_left_alone():
    for data in (plain(), parse_config(plain()).plain(), {}, {"replay": None}):
        assert upgraded(data) == data
    data = yaml.safe_load((SAVED / "ppo-medium.yaml").read_text()) | {"levels": {}}
    assert upgraded(data) == data  # so that what it cannot have is refused


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
    assert epsilons[0] == pytest.approx(start, abs=1e-9)
    assert epsilons == sorted(epsilons, reverse=True)
    assert min(epsilons) >= min(start, end) - 1e-9


def test_what_does_not_go_together_is_named_with_its_remedy():
    assert complaint(plain({"lag": 1, "fragment_steps": 30})) == (
        "lag 1 needs whole episodes: add --set fragment_steps=null"
    )
    assert parse_config(plain({"lag": 1})).lag == 1
    assert complaint(plain({"lag": "free", "max_staleness": 8, "fragment_steps": 30})) == (
        "lag free needs whole episodes: add --set fragment_steps=null"
    )
    assert complaint(plain({"lag": "free"})) == "lag free needs a bound: add --set max_staleness=32"


def test_free_is_bounded_and_both_are_of_the_science():
    config = parse_config(plain({"lag": "free", "max_staleness": 8}))
    assert (config.lag, config.is_free, config.most_ahead) == ("free", True, 8)
    assert (config.science["lag"], config.science["max_staleness"]) == ("free", 8)
    assert parse_config(config.plain()) == config


@pytest.mark.parametrize("lag", [0, 3])
def test_an_exact_run_says_nothing_of_staleness(lag):
    config = parse_config(plain({"lag": lag}))
    assert (config.is_free, config.most_ahead) == (False, lag)
    assert "max_staleness" not in config.plain()


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"fragment_steps": 5}, "fragment_steps: rule ppo has no use for it, leave it out"),
        ({"replay": {"capacity": 5}}, "replay: rule ppo has no use for it, leave it out"),
        ({"exploration": {}}, "exploration: rule ppo has no use for it, leave it out"),
        ({"dqn": DQN}, "dqn: rule ppo has no use for it, leave it out"),
        ({"discount": 1}, "discount: input should be less than 1, not 1"),
        ({"network": {"kind": "dueling"}}, "network.kind: input should be 'actor-critic' or 'exits', not 'dueling'"),
    ],
)
def test_what_a_policy_has_no_use_for_is_refused(changes, text):
    assert complaint(PPO | changes) == text


def test_only_policies_are_scored_by_sampling():
    assert parse_config(PPO).evaluation.mode == "greedy"
    assert parse_config(PPO | {"evaluation": {"mode": "sample"}}).evaluation.mode == "sample"
