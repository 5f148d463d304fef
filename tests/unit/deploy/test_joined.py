"""Actors on other machines, as the status shows them."""

import pytest

from railctl.common.records.heartbeats import ActorReport, Heartbeat
from railctl.common.wire.keys import Alive
from railctl.deploy.joined import MOST, Joined
from railctl.deploy.plan import actors


@pytest.fixture
def joined():
    return Joined(["easy", "very-easy"])


def beat(process, role="actor", pid=7):
    report = ActorReport(acted=1, kept=0) if role == "actor" else None
    return Heartbeat(process=process, role=role, pid=pid, state="acting episode 3", report=report)


def names(joined):
    return [status.process for status in joined.statuses()]


def test_who_has_a_token_and_a_heartbeat_is_shown_until_the_token_goes(joined):
    alive = Alive("actor", "actor-node7-easy-0", "one")
    joined.on_alive(alive, True)
    assert names(joined) == []  # actors of this machine have tokens, too
    joined.on_beat(beat(alive.process))
    [status] = joined.statuses()
    assert (status.process, status.pid, status.state, status.serves) == (alive.process, 7, "acting episode 3", "easy")
    joined.on_alive(alive, False)
    assert names(joined) == []
    joined.on_beat(beat(alive.process))  # was on its way
    assert names(joined) == []


def test_one_that_came_again_does_not_go_with_its_former_token(joined):
    process = "actor-node7-easy-0"
    joined.on_alive(Alive("actor", process, "one"), True)
    joined.on_alive(Alive("actor", process, "two"), True)
    joined.on_alive(Alive("actor", process, "one"), False)
    joined.on_beat(beat(process))
    assert names(joined) == [process]


def test_only_actors_join(joined):
    joined.on_alive(Alive("learner", "learner", "one"), True)
    joined.on_beat(beat("learner", "learner"))
    joined.on_alive(Alive("actor", "actor-x-easy-0", "one"), True)
    joined.on_beat(beat("actor-x-easy-0", "router"))
    assert names(joined) == []


@pytest.mark.parametrize("level", ["easy", "very-easy", "any"])
def test_the_name_of_an_actor_says_what_it_serves(joined, level):
    [spec] = actors({level: 1}, "node-7")
    joined.on_alive(Alive("actor", spec.name, "one"), True)
    joined.on_beat(beat(spec.name))
    assert joined.statuses()[0].serves == level


def test_however_many_pretend_to_join_the_status_stays_one(joined):
    for number in range(MOST + 5):
        joined.on_alive(Alive("actor", f"actor-x-easy-{number}", "one"), True)
        joined.on_beat(beat(f"actor-x-easy-{number}"))
    assert len(names(joined)) == MOST
