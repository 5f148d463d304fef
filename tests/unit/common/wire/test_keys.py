"""Keys are valid, of one meaning each, and tokens are parsed by the type that builds them."""

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.wire import keys
from railctl.common.wire.codec import encoding_of
from railctl.common.wire.keys import ALL_ALIVE, Alive, Service, Topic

TOPICS = [value for value in vars(keys).values() if isinstance(value, Topic)]
SERVICES = [value for value in vars(keys).values() if isinstance(value, Service)]
PARTS = st.text("abcdefghijklmnopqrstuvwxyz0123456789-_.", min_size=1, max_size=20)


def test_the_channels_of_a_run_are_these():
    assert sorted(channel.key for channel in [*TOPICS, *SERVICES]) == [
        "checkpoints",
        "command/learner",
        "command/scale",
        "command/status",
        "command/stop",
        "fragments",
        "heartbeats",
        "heartbeats/far",
        "history/episodes",
        "history/evaluations",
        "lease",
        "list/checkpoints",
        "pull/checkpoint",
        "pull/levels",
        "pull/weights",
        "railctl/run",
        "rows/episodes",
        "rows/evaluations",
    ]


@pytest.mark.parametrize("channel", [*TOPICS, *SERVICES], ids=lambda channel: channel.key)
def test_a_key_is_one_that_zenoh_takes_and_is_no_token(channel):
    key = zenoh.KeyExpr(keys.absolute("railctl/0123456789ab", channel.key))
    assert "*" not in str(key)
    assert not key.intersects(zenoh.KeyExpr(f"railctl/0123456789ab/{ALL_ALIVE}"))


def test_what_travels_on_a_channel_has_an_encoding_of_its_own():
    travelling = {topic.record for topic in TOPICS} | {service.request for service in SERVICES}
    travelling |= {service.answer for service in SERVICES}
    assert len({encoding_of(record) for record in travelling}) == len(travelling)


@settings(deadline=None)
@given(role=PARTS, process=PARTS, incarnation=PARTS)
def test_a_token_is_parsed_from_its_own_key(role, process, incarnation):
    alive = Alive(role, process, incarnation)
    assert Alive.parse(alive.key) == alive
    assert zenoh.KeyExpr(ALL_ALIVE).includes(zenoh.KeyExpr(alive.key))


@pytest.mark.parametrize(
    "key",
    [
        "",
        "alive",
        "alive/actor/actor-easy-0",
        "alive/actor/actor-easy-0/9f3c/more",
        "dead/actor/actor-easy-0/9f3c",
        "alive//actor-easy-0/9f3c",
        "alive/actor/actor-easy-0/",
        "/alive/actor/actor-easy-0/9f3c",
    ],
)
def test_what_is_no_token_is_refused_by_name(key):
    with pytest.raises(ValueError, match="is not alive/ROLE/PROCESS/INCARNATION") as caught:
        Alive.parse(key)
    assert repr(key) in str(caught.value)
