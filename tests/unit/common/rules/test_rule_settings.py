"""What each update rule can be told, and what it says of itself."""

import pytest
from pydantic import ValidationError

from railctl.common.rules import rules, settings_of
from railctl.common.rules.settings import RuleSettings
from railctl.common.strict import ConfigError, describe

VALUES = {"dqn": {"learning_rate": 0.1, "batch_size": 8, "learn_every_steps": 4}, "replay": {"capacity": 100}}
POLICY = {"ppo": {"learning_rate": 0.1, "epochs": 2}}
GIVEN = {
    "dqn": VALUES,
    "drqn": VALUES,
    "imitate": {
        "imitation": {"learning_rate": 0.1, "updates": 2, "batch_size": 8},
        "replay": {"capacity": 100},
    },
    "ppo": POLICY,
    "ppor": {"ppo": POLICY["ppo"] | {"batch_size": 8}, "replay": {"capacity": 100}},
    "sil": POLICY | {"sil": {"epochs": 2, "batch_size": 8}, "replay": {"capacity": 100, "beta": 0}},
}


def settings(rule, changes=()):
    given = {key: dict(value) for key, value in GIVEN[rule].items()}
    for key, value in dict(changes).items():
        section, _, name = key.partition(".")
        if name:
            given.setdefault(section, {})[name] = value
        else:
            given[section] = value
    return settings_of(rule).model_validate(given)


def test_there_is_a_file_a_rule():
    assert rules() == ("dqn", "drqn", "imitate", "ppo", "ppor", "sil")
    assert all(issubclass(settings_of(rule), RuleSettings) for rule in rules())
    assert set(GIVEN) == set(rules())


@pytest.mark.parametrize("rule", ["dqnn", "settings", "replay", "values", "policies", "", "..dqn", None])
def test_an_unknown_rule_is_named(rule):
    with pytest.raises(ConfigError, match=r"^unknown rule .*known are dqn, drqn, imitate, ppo, ppor, sil$"):
        settings_of(rule)


def test_a_rule_has_its_sections_and_no_others():
    sections = {rule: set(settings(rule).model_dump()) - {"network", "discount"} for rule in rules()}
    values = {"dqn", "replay", "exploration", "fragment_steps"}
    assert sections == {
        "dqn": values,
        "drqn": values,
        "imitate": {"teacher", "imitation", "replay"},
        "ppo": {"ppo", "start_from"},
        "ppor": {"ppo", "replay", "start_from"},
        "sil": {"ppo", "sil", "replay", "start_from", "demonstrations"},
    }


def test_a_rule_has_a_network_of_its_own_kind():
    assert {rule: settings(rule).network.kind for rule in rules()} == {
        "dqn": "plain",
        "drqn": "recurrent",
        "imitate": "actor-critic",
        "ppo": "actor-critic",
        "ppor": "actor-critic",
        "sil": "actor-critic",
    }
    for kind in ("dueling", "dueling-apart"):
        assert settings("dqn", {"network": {"kind": kind}}).network.kind == kind


def test_a_rule_answers_what_the_rest_asks():
    assert [rule for rule in rules() if settings(rule).has_probabilities] == ["imitate", "ppo", "ppor", "sil"]
    assert [settings(rule).steps_a_fragment for rule in rules()] == [None] * 6
    assert settings("dqn", {"fragment_steps": 30}).steps_a_fragment == 30
    assert [settings(rule).teaching for rule in rules()] == [None, None, (10, 4, 16), None, None, None]
    assert {settings(rule).learns_from_following for rule in rules()} == {False}
    assert settings("dqn", {"dqn.transitions": "step"}).learns_from_following
    assert [settings(rule).epsilon(0, 100) for rule in rules()] == [0.9, 0.9, 1, 0, 0, 0]
    assert settings("drqn").epsilon(50, 100) == pytest.approx(0.01)
    assert {settings(rule).module(12, 3, seed=1) for rule in rules()} == {None}


@pytest.mark.parametrize(
    ("switches", "shares"),
    [({}, (0, 0)), ({"target_tau": 0.1}, (0.1, 0)), ({"target_tau": 0.1, "target_every": "episode"}, (0, 0.1))],
)
def test_a_target_follows_after_updates_or_at_the_end_of_episodes(switches, shares):
    dqn = settings("dqn", {f"dqn.{name}": value for name, value in switches.items()}).dqn
    assert (dqn.share_an_update, dqn.share_an_episode) == shares


@pytest.mark.parametrize("rule", ["dqn", "drqn"])
def test_runs_with_a_lag_have_whole_episodes(rule):
    preset = {"fragment_steps": 30, "dqn": {"batch_size": 3}}
    assert settings_of(rule).adapted(preset, 1) == {"dqn": {"batch_size": 3}}
    assert settings_of(rule).adapted(preset, 0) == preset


@pytest.mark.parametrize("rule", rules())
def test_settings_come_back_from_plain_data(rule):
    found = settings(rule)
    assert settings_of(rule).model_validate(found.model_dump(mode="json")) == found


@pytest.mark.parametrize(
    ("rule", "key", "value", "text"),
    [
        (
            "dqn",
            "network.kind",
            "recurrent",
            "network.kind: input should be 'plain', 'dueling' or 'dueling-apart', not 'recurrent'",
        ),
        ("drqn", "network.kind", "dueling", "network.kind: input should be 'recurrent', not 'dueling'"),
        ("drqn", "network.kind", "dueling-apart", "network.kind: input should be 'recurrent', not 'dueling-apart'"),
        ("ppo", "network.kind", "plain", "network.kind: input should be 'actor-critic' or 'exits', not 'plain'"),
        (
            "ppo",
            "network.hidden",
            [],
            "network.hidden: input should be a list of at least 1 item, not ",
        ),
        ("dqn", "network.hidden", [4097], "network.hidden.0: input should be less than or equal to 4096, not 4097"),
        ("dqn", "network.width", 3, "unknown key network.width: known are hidden, kind"),
        ("dqn", "dqn.sequence_decisions", 8, "unknown key dqn.sequence_decisions: known are batch_size, double, "),
        (
            "drqn",
            "dqn.sequence_decisions",
            0,
            "dqn.sequence_decisions: input should be greater than or equal to 1, not 0",
        ),
        ("drqn", "dqn.double", True, "dqn: double needs a target network: set target_tau"),
        (
            "drqn",
            "dqn.transitions",
            "step",
            "dqn.transitions step: the sequences of drqn lead from decision to decision, make it span",
        ),
        ("dqn", "dqn.double", "reversed", "dqn: double needs a target network: set target_tau"),
        ("dqn", "dqn.double", "reverse", "dqn.double: input should be False, True or 'reversed', not 'reverse'"),
        (
            "drqn",
            "dqn.target_every",
            "episode",
            "dqn: target_every episode needs a target network: set target_tau",
        ),
        ("dqn", "dqn.target_every", 7, "dqn.target_every: input should be 'update' or 'episode', not 7"),
        ("dqn", "dqn.batch_size", 101, "dqn.batch_size 101 exceeds replay.capacity 100: make one fit the other"),
        ("dqn", "replay.alpha", 0.5, "unknown key replay.alpha: known are capacity, kind"),
        ("dqn", "replay.capacity", 0, "replay.capacity: input should be greater than or equal to 1, not 0"),
        ("dqn", "replay.kind", "newest", "replay.kind: unknown 'newest': known are 'uniform', 'prioritized'"),
        (
            "dqn",
            "replay",
            {"kind": "prioritized", "capacity": 9, "beta": 2},
            "replay.beta: input should be less than or equal to 1, not 2",
        ),
        (
            "dqn",
            "replay",
            {"kind": "prioritized", "capacity": 100, "alpha_end": 0.7},
            "replay: alpha_end 0.7 exceeds alpha 0.6: alpha falls, make it less",
        ),
        ("dqn", "exploration.epsilon_end", 0, "exploration.epsilon_end: input should be greater than 0, not 0"),
        ("dqn", "fragment_steps", 0, "fragment_steps: input should be greater than or equal to 1, not 0"),
        ("ppo", "exploration.decay_share", 0.5, "unknown key exploration: "),
        ("ppo", "replay.capacity", 5, "unknown key replay: "),
        ("ppo", "fragment_steps", 5, "unknown key fragment_steps: "),
        ("ppo", "ppo.batch_size", 5, "unknown key ppo.batch_size: known are advantages, anchor_weight, clip, "),
        ("ppo", "ppo.clip", 0, "ppo.clip: input should be greater than 0, not 0"),
        ("ppo", "discount", 1, "discount: input should be less than 1, not 1"),
        ("ppor", "replay.kind", "prioritized", "replay.kind: input should be 'uniform', not 'prioritized'"),
        ("ppor", "replay.beta", 0.5, "unknown key replay.beta: known are capacity, kind"),
        ("ppor", "ppo.batch_size", 101, "ppo.batch_size 101 exceeds replay.capacity 100: make one fit the other"),
        ("sil", "sil.batch_size", 101, "sil.batch_size 101 exceeds replay.capacity 100: make one fit the other"),
        ("sil", "replay.kind", "uniform", "replay.kind: input should be 'prioritized', not 'uniform'"),
        (
            "sil",
            "replay.beta",
            0.4,
            "replay.beta 0.4: self-imitation is to favour what turned out well, make it 0",
        ),
        ("sil", "ppo.batch_size", 5, "unknown key ppo.batch_size: known are advantages, anchor_weight, clip, "),
        ("sil", "sil.value_weight", -1, "sil.value_weight: input should be greater than or equal to 0, not -1"),
    ],
)
def test_what_a_rule_does_not_have_is_named(rule, key, value, text):
    with pytest.raises(ValidationError) as caught:
        settings(rule, {key: value})
    said = describe(caught.value, settings_of(rule))
    assert said.startswith(text)
    assert "\n" not in said


def test_a_batch_of_a_policy_with_a_replay_must_be_given():
    with pytest.raises(ValidationError) as caught:
        settings_of("ppor").model_validate(POLICY | {"replay": {"capacity": 100}})
    assert describe(caught.value, settings_of("ppor")) == "ppo.batch_size is missing: give it a value"
