"""The promise of the system: the curve is a function of configuration and seed, whatever happens meanwhile."""

import signal

import pytest

from railctl.common.locks import living
from railctl.deploy.events import last_events
from railctl.deploy.runs import supervised
from railctl.tools.bench.alone import Alone

EPISODES = 40
WITH_LAG = ("--lag", "2", "--set", "fragment_steps=null")
KILLED_AFTER = {2: "actor-easy-0", 4: "learner", 6: "evaluator", 8: "router", 10: "supervisor"}


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3])
def test_any_number_of_actors_gives_the_same_curve(clusters, undisturbed, count):
    clusters.up(f"with-{count}", "--actors", f"easy={count}")
    assert clusters.curve(f"with-{count}") == undisturbed
    assert len(clusters.actors(f"with-{count}")) in range(min(count, 2), count + 1)


def test_one_process_without_a_message_gives_the_same_curve(clusters, undisturbed):
    alone = Alone(clusters.folder("undisturbed").config()).run()
    found = [(episode.digest, episode.steps, episode.decisions) for episode in alone]
    rows = [row for row in undisturbed if "digest" in row]
    assert found == [(row["digest"], row["steps"], row["decisions"]) for row in rows]


@pytest.mark.slow
def test_flatland_itself_gives_the_curve_of_the_compiled_world(clusters, undisturbed):
    clusters.up("stepped", "--engine", "flatland")
    assert clusters.curve("stepped") == undisturbed


@pytest.mark.slow
def test_a_lag_gives_its_own_curve_every_time(clusters, undisturbed):
    clusters.up("lag-a", "--actors", "easy=3", *WITH_LAG)
    clusters.up("lag-b", "--actors", "easy=2", *WITH_LAG)
    assert clusters.curve("lag-a") == clusters.curve("lag-b")
    assert clusters.curve("lag-a") != undisturbed


def test_killing_everything_one_after_another_changes_nothing(clusters, undisturbed, tail):
    clusters.up("killed", "--actors", "easy=3", "--detach")
    rows = tail("killed")
    for episodes, process in KILLED_AFTER.items():
        rows.until(episodes)
        clusters.kill("killed", process)
    clusters.pause("killed")  # or it may be over before anybody looks
    clusters.wait(lambda: not supervised(clusters.folder("killed")))
    assert clusters.status("killed")["state"] == "unsupervised"
    survivors = living(clusters.folder("killed"))
    assert survivors  # they worked on without their supervisor
    clusters.goes_on_paused("killed")
    rows.rest()
    assert clusters.curve("killed") == undisturbed
    assert len(clusters.actors("killed")) > 1
    assert rows.episodes == list(range(EPISODES))
    assert rows.evaluations == [20, 40]
    assert living(clusters.folder("killed")) == {}
    events = last_events(clusters.folder("killed"), 1000)
    assert {event.process for event in events if event.kind == "died"} >= {"actor-easy-0", "learner"}
    assert {event.process for event in events if event.kind == "adopted"} >= set(survivors)  # some had just begun
    assert {"paused", "resumed"} <= {event.kind for event in events}
    assert [event.kind for event in events].count("finished") == 1
    assert [event.time for event in events] == sorted(event.time for event in events)


def test_a_learner_that_acts_itself_and_is_killed_gives_the_same_curve(clusters, undisturbed, tail):
    clusters.up("itself", "--detach")
    rows = tail("itself")
    for episodes in (3, 9):
        rows.until(episodes)
        clusters.kill("itself", "learner")
    rows.rest()
    assert clusters.curve("itself") == undisturbed
    assert clusters.actors("itself") == {"learner"}


SMALL = ("--set", "network.hidden=[32, 32]", "--set", "dqn.batch_size=32")  # an LSTM learns slowly
ALGORITHMS = {
    "dqn": (),
    "ddqn": (),
    "ddqn-step": ("--set", "dqn.transitions=step"),
    "dddqn": ("--set", "replay=prioritized"),
    "drqn": SMALL,
    "drqn-prioritized": (*SMALL, "--set", "replay=prioritized"),
    "ppo": (),
    "ppor": (),
    "sil": (),
    "dddqn-interlocked": ("--set", "interlocking=safe"),
    "sil-interlocked": ("--set", "interlocking=planned"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", ALGORITHMS)
def test_every_algorithm_goes_on_from_its_snapshots_as_if_nothing_had_happened(clusters, tail, case):
    options = ("--algorithm", case.partition("-")[0], *ALGORITHMS[case])
    clusters.up_any(f"{case}-left-alone", *options)
    clusters.up_any(f"{case}-killed", "--actors", "easy=2", "--detach", *options)
    rows = tail(f"{case}-killed")
    for episodes, process in ((5, "learner"), (10, "actor-easy-0"), (15, "learner")):
        rows.until(episodes)
        clusters.kill(f"{case}-killed", process)
    rows.rest()
    assert rows.episodes == list(range(EPISODES))
    assert clusters.curve(f"{case}-killed") == clusters.curve(f"{case}-left-alone")


@pytest.mark.slow
def test_a_hung_actor_is_killed_and_replaced(clusters, undisturbed, tail):
    clusters.up("hung", "--actors", "easy=1", "--set", "cluster.hang_timeout_s=5", "--detach")
    rows = tail("hung")
    rows.until(2)
    before = living(clusters.folder("hung"))["actor-easy-0"]
    clusters.kill("hung", "actor-easy-0", signal.SIGSTOP)
    rows.rest()
    assert clusters.curve("hung") == undisturbed
    log = (clusters.folder("hung").logs / "supervisor.log").read_text()
    assert f"sends SIGKILL to actor-easy-0, process {before}" in log
