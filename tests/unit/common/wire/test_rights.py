"""Who far away may do what: every right is written here, so that none comes by chance."""

from railctl.common.wire import keys
from railctl.common.wire.rights import BEHIND_A_RELAY, RIGHTS

SEEN = {"rows/episodes", "rows/evaluations", "checkpoints", "heartbeats", "heartbeats/far"}
TOLD = {
    "railctl/run",
    "command/status",
    "history/episodes",
    "history/evaluations",
    "list/checkpoints",
    "pull/checkpoint",
}
BEHIND = {"actor": "actor", "reader": "reader", "operator": "reader"}


def of(role):
    rights = RIGHTS[role]
    return [{channel.key for channel in channels} for channels in (rights.publishes, rights.hears, rights.asks)]


def test_an_actor_acts():
    assert of("actor") == [
        {"fragments", "heartbeats/far"},
        {"heartbeats", "heartbeats/far"},
        {"railctl/run", "pull/levels", "lease", "pull/weights"},
    ]
    assert RIGHTS["actor"].holds == ("alive/actor/*/*",)


def test_a_reader_looks_and_changes_nothing():
    assert of("reader") == [set(), SEEN, TOLD]
    assert RIGHTS["reader"].holds == ()


def test_an_operator_commands_besides():
    assert of("operator") == [set(), SEEN, TOLD | {"command/scale", "command/stop", "command/learner"}]
    assert RIGHTS["operator"].holds == ()


def test_a_relay_may_what_those_behind_it_may_who_command_nothing():
    assert of("relay") == [
        {"fragments", "heartbeats/far"},
        SEEN,
        TOLD | {"pull/levels", "lease", "pull/weights"},
    ]
    assert RIGHTS["relay"].holds == ("alive/actor/*/*",)
    assert {role: RIGHTS[may] for role, may in BEHIND.items()} == BEHIND_A_RELAY


def test_the_host_connects_to_nobody():
    assert set(RIGHTS) == {"actor", "reader", "operator", "relay"}


def test_nobody_far_sends_what_the_runs_own_machine_believes():
    sent = {topic for rights in RIGHTS.values() for topic in rights.publishes}
    assert sent == {keys.FRAGMENTS, keys.FAR_HEARTBEATS}
