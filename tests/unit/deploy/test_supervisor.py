"""The supervisor's mind, replayed: histories of events in, orders out."""

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from railctl.common.process import EXIT_FATAL
from railctl.deploy.plan import actors, cluster
from railctl.deploy.supervisor import (
    FIRST_BACK_OFF_S,
    LONGEST_BACK_OFF_S,
    START_PATIENCE_S,
    STOP_PATIENCE_S,
    Adopted,
    Beat,
    Exited,
    Happening,
    Kill,
    Launch,
    Limits,
    Quit,
    StopAsked,
    Supervisor,
    Terminate,
    Tick,
    Wanted,
)

HANG_S = 10.0
LIMITS = Limits(hang_timeout_s=HANG_S, max_restarts=3, restart_window_s=100.0)
HERE, AWAY = Tick(connected=True), Tick(connected=False)


def supervisor(counts=None, limits=LIMITS):
    return Supervisor(cluster({"easy": 1} if counts is None else counts), limits)


def running(counts=None, limits=LIMITS):
    """A cluster whose processes all run, as of time 0."""
    mind = supervisor(counts, limits)
    for _ in range(2):  # the evaluator starts when the learner has come
        mind.on(HERE, 0.0)
        for name in mind.wards:
            mind.on(Beat(name), 0.0)
    return mind


def launched(orders):
    return [order.spec.name for order in orders if isinstance(order, Launch)]


def died(name, code=1, words=""):
    return Exited(name, code, words)


def keep_alive(mind, now, but=()):
    for name in mind.wards:
        if name not in but:
            mind.on(Beat(name), now)


def states(mind):
    return {name: ward.state for name, ward in mind.wards.items()}


# Starting


def test_the_first_tick_launches_everything_but_the_evaluator_the_router_first():
    mind = supervisor({"easy": 2})
    assert launched(mind.on(AWAY, 5.0)) == ["router", "learner", "actor-easy-0", "actor-easy-1"]
    assert {name for name, state in states(mind).items() if state == "starting"} == set(mind.wards) - {"evaluator"}
    assert mind.on(AWAY, 5.1) == []


@pytest.mark.parametrize("event", [Beat("learner"), Adopted("learner")])
def test_the_evaluator_starts_when_the_learner_has_come(event):
    mind = supervisor()
    mind.on(HERE, 0.0)
    mind.on(Beat("actor-easy-0"), 1.0)
    assert mind.on(HERE, 1.0) == []
    mind.on(event, 2.0)
    assert launched(mind.on(HERE, 2.0)) == ["evaluator"]


def test_a_learner_that_is_about_to_come_has_not_come():
    mind = supervisor()
    mind.on(HERE, 0.0)
    mind.on(Beat("learner", starts=True), 1.0)
    assert states(mind)["learner"] == "starting"
    assert mind.on(HERE, 1.0) == []


def test_an_evaluator_that_died_starts_again_whatever_the_learner_does():
    mind = running()
    mind.on(died("learner"), 1.0)
    mind.on(died("evaluator"), 1.0)
    assert launched(mind.on(HERE, 1.0 + FIRST_BACK_OFF_S)) == ["learner", "evaluator"]


def test_a_process_runs_from_its_first_beat_on():
    mind = supervisor()
    mind.on(AWAY, 0.0)
    assert mind.on(Beat("learner"), 1.0) == []
    assert states(mind)["learner"] == "running"
    assert states(mind)["router"] == "starting"
    assert mind.on(Beat("nobody"), 1.0) == []


# What is written down


def test_a_death_a_silence_and_an_end_are_told_once():
    mind = running()
    mind.on(died("evaluator", -9), 1.0)
    assert mind.take_story() == [
        Happening("died", "evaluator", "evaluator died (signal 9): starts again in 0.5 s"),
    ]
    assert mind.take_story() == []
    keep_alive(mind, 5.0, but=("learner",))
    mind.on(HERE, 1.0 + HANG_S)
    mind.on(HERE, 1.1 + HANG_S)
    assert mind.take_story() == [Happening("hung", "learner", "learner gave no sign of life for 10 s: killed")]
    mind.on(died("learner", EXIT_FATAL, "no room"), 12.0)
    assert mind.take_story() == [Happening("died", "learner", "learner cannot go on: no room")]


# Death


def test_a_process_that_dies_again_and_again_starts_later_each_time_and_then_ends_the_run():
    mind = running()
    now = 1.0
    for back_off in (0.5, 1.0, 2.0):
        assert mind.on(died("learner"), now) == []
        assert mind.on(HERE, now + back_off - 0.01) == []
        assert launched(mind.on(HERE, now + back_off)) == ["learner"]
        now += back_off + 1.0
    orders = mind.on(died("learner", words="no disk"), now)
    assert mind.stopping == Quit(
        "failed", "learner died (exit code 1) 4 times within 100 s: no disk; see logs/learner.log"
    )
    assert orders == [Terminate("evaluator"), Terminate("actor-easy-0")]
    assert mind.problems[-1] == mind.stopping.reason


def test_back_off_doubles_up_to_a_limit():
    mind = running(limits=Limits(HANG_S, max_restarts=50, restart_window_s=1e9))
    now, waits = 0.0, []
    for _ in range(8):
        mind.on(died("actor-easy-0"), now)
        waits.append(mind.wards["actor-easy-0"].since - now)
        now = mind.wards["actor-easy-0"].since
        assert launched(mind.on(HERE, now)) == ["actor-easy-0"]
        keep_alive(mind, now)
    assert waits == [0.5, 1, 2, 4, 8, 10, 10, 10]
    assert (waits[0], waits[-1]) == (FIRST_BACK_OFF_S, LONGEST_BACK_OFF_S)
    assert mind.wards["actor-easy-0"].restarts == 8


def test_deaths_outside_the_window_are_forgotten():
    mind = running()
    for round_ in range(10):
        now = 101.0 * round_
        keep_alive(mind, now)
        assert mind.on(died("learner"), now) == []
        assert mind.wards["learner"].since == now + FIRST_BACK_OFF_S
        keep_alive(mind, now + FIRST_BACK_OFF_S)
        assert launched(mind.on(HERE, now + FIRST_BACK_OFF_S)) == ["learner"]
    assert mind.stopping is None
    assert mind.wards["learner"].restarts == 10


def test_processes_die_each_on_its_own_account():
    mind = running({"easy": 2})
    for number in range(3):
        mind.on(died("actor-easy-0"), float(number))
        mind.on(died("actor-easy-1"), float(number))
        assert launched(mind.on(AWAY, number + 50.0)) == ["actor-easy-0", "actor-easy-1"]
    assert mind.stopping is None
    assert states(mind)["router"] == "running"


def test_no_restart_at_all_may_be_allowed():
    mind = running(limits=Limits(HANG_S, max_restarts=0, restart_window_s=100.0))
    mind.on(died("actor-easy-0", code=-11), 1.0)
    assert mind.stopping.reason.startswith("actor-easy-0 died (signal 11) 1 times within 100 s; see logs/")


def test_what_a_restart_cannot_mend_ends_the_run_with_its_last_words():
    mind = running()
    orders = mind.on(died("learner", code=EXIT_FATAL, words="snapshot is damaged"), 1.0)
    assert mind.stopping == Quit("failed", "learner cannot go on: snapshot is damaged")
    assert orders == [Terminate("evaluator"), Terminate("actor-easy-0")]
    assert "learner" not in mind.wards


@pytest.mark.parametrize(("code", "text"), [(1, "died (exit code 1)"), (-9, "died (signal 9)"), (None, "died")])
def test_a_death_is_told_with_what_is_known_of_it(code, text):
    mind = running()
    mind.on(died("evaluator", code), 1.0)
    assert mind.problems == [f"evaluator {text}: starts again in 0.5 s"]


def test_a_process_that_nobody_asked_to_end_died_even_if_it_ended_well():
    mind = running()
    mind.on(died("actor-easy-0", code=0), 1.0)
    assert states(mind)["actor-easy-0"] == "waiting"


def test_problems_do_not_pile_up_without_end():
    mind = running(limits=Limits(HANG_S, max_restarts=10_000, restart_window_s=1e9))
    for number in range(300):
        mind.on(died("actor-easy-0"), float(number))
    assert len(mind.problems) == 100


# Silence


def test_a_silent_process_is_killed_once_and_started_again():
    mind = running()
    keep_alive(mind, 9.0, but=["learner"])
    assert mind.on(HERE, HANG_S) == []
    assert mind.on(HERE, HANG_S + 0.1) == [Kill("learner")]
    assert mind.problems == ["learner gave no sign of life for 10 s: killed"]
    assert mind.on(HERE, HANG_S + 0.2) == []
    mind.on(died("learner", code=-9), 10.3)
    assert launched(mind.on(HERE, 10.3 + FIRST_BACK_OFF_S)) == ["learner"]


def test_silence_counts_only_while_we_could_hear():
    mind = running()
    assert mind.on(AWAY, HANG_S + 1) == []
    assert mind.on(AWAY, 2 * HANG_S) == []
    assert mind.on(HERE, 2 * HANG_S + 1) == []  # and from here on it counts anew
    assert mind.on(HERE, 3 * HANG_S + 1) == []
    orders = mind.on(HERE, 3 * HANG_S + 1.1)
    assert set(orders) == {Kill(name) for name in ("router", "learner", "evaluator", "actor-easy-0")}


def test_a_beat_ends_silence():
    mind = running()
    for now in range(0, 100, 5):
        keep_alive(mind, float(now))
        assert mind.on(HERE, now + 4.9) == []


def test_a_process_that_starts_has_more_patience():
    mind = supervisor()
    mind.on(HERE, 0.0)
    assert mind.on(HERE, START_PATIENCE_S) == []
    keep_alive(mind, START_PATIENCE_S, but=["learner"])
    assert mind.on(HERE, START_PATIENCE_S + 0.1) == [Kill("learner")]


def test_a_process_that_starts_and_says_that_it_gets_on_has_as_much_patience_again():
    mind = supervisor()
    mind.on(HERE, 0.0)
    mind.on(Beat("learner", starts=True), START_PATIENCE_S)
    keep_alive(mind, 2 * START_PATIENCE_S, but=["learner", "evaluator"])
    assert Kill("learner") not in mind.on(HERE, 2 * START_PATIENCE_S)
    assert Kill("learner") in mind.on(HERE, 2 * START_PATIENCE_S + 0.1)


def test_a_process_that_starts_has_no_less_patience_than_one_that_runs():
    mind = supervisor(limits=Limits(2 * START_PATIENCE_S, 3, 100.0))
    mind.on(HERE, 0.0)
    assert mind.on(HERE, 2 * START_PATIENCE_S) == []
    assert len(mind.on(HERE, 2 * START_PATIENCE_S + 0.1)) == 3  # all that have been started


def test_a_router_that_lets_nobody_connect_is_killed_in_the_end():
    mind = running()
    assert mind.on(AWAY, START_PATIENCE_S) == []
    assert mind.on(AWAY, START_PATIENCE_S + 0.1) == [Kill("router")]
    assert mind.on(AWAY, 10 * START_PATIENCE_S) == []  # nobody else is to blame
    mind.on(died("router", code=-9), 10 * START_PATIENCE_S)
    now = 10 * START_PATIENCE_S + FIRST_BACK_OFF_S
    assert launched(mind.on(AWAY, now)) == ["router"]
    assert mind.on(AWAY, now + START_PATIENCE_S) == []  # the new one has as much time


# Taking over


def test_processes_that_live_are_taken_over_and_the_others_are_started():
    mind = supervisor({"easy": 2})
    for name in ("router", "actor-easy-1"):
        assert mind.on(Adopted(name), 3.0) == []
    assert launched(mind.on(AWAY, 3.1)) == ["learner", "actor-easy-0"]
    assert states(mind)["actor-easy-1"] == "running"
    mind.on(died("actor-easy-1", code=None), 4.0)
    assert mind.problems == ["actor-easy-1 died: starts again in 0.5 s"]


def test_an_actor_that_nobody_wants_any_more_is_killed_and_forgotten():
    mind = supervisor({"easy": 1})
    assert mind.on(Adopted("actor-easy-7"), 3.0) == [Kill("actor-easy-7")]
    assert mind.on(died("actor-easy-7", code=None), 3.1) == []
    assert mind.stopping is None
    assert "actor-easy-7" not in mind.wards


def test_who_lived_already_when_it_was_launched_is_looked_after_instead():
    mind = supervisor()
    mind.on(AWAY, 0.0)
    assert mind.on(Adopted("learner"), 2.0) == []
    assert states(mind)["learner"] == "running"
    assert mind.problems == []
    assert mind.wards["learner"].restarts == 0


def test_who_is_taken_over_hung_is_noticed():
    mind = supervisor()
    mind.on(Adopted("learner"), 0.0)
    mind.on(HERE, 1.0)
    keep_alive(mind, 10.0, but=["learner"])
    assert Kill("learner") in mind.on(HERE, 1.0 + HANG_S + 0.1)


# Scaling


def test_scaling_up_launches_only_the_new_ones_at_once():
    mind = running({"easy": 1})
    assert launched(mind.on(Wanted(tuple(actors({"easy": 3, "hard": 1}))), 1.0)) == [
        "actor-easy-1",
        "actor-easy-2",
        "actor-hard-0",
    ]


def test_scaling_down_ends_the_last_ones_and_forgets_them():
    mind = running({"easy": 3})
    assert mind.on(Wanted(tuple(actors({"easy": 1}))), 1.0) == [Terminate("actor-easy-1"), Terminate("actor-easy-2")]
    assert mind.on(Wanted(tuple(actors({"easy": 1}))), 1.1) == []  # told again, nothing new
    assert mind.on(died("actor-easy-1", code=0), 2.0) == []
    assert mind.on(died("actor-easy-2", code=EXIT_FATAL), 2.0) == []  # nobody cares any more
    assert set(mind.wards) == {"router", "learner", "evaluator", "actor-easy-0"}
    assert mind.stopping is None
    assert mind.problems == []


def test_scaling_to_nothing_leaves_the_others_alone():
    mind = running({"easy": 1})
    assert mind.on(Wanted(()), 1.0) == [Terminate("actor-easy-0")]
    mind.on(died("actor-easy-0", code=0), 1.5)
    assert set(mind.wards) == {"router", "learner", "evaluator"}


def test_an_actor_that_does_not_end_when_scaled_down_is_killed():
    mind = running({"easy": 1})
    mind.on(Wanted(()), 1.0)
    keep_alive(mind, 1.0 + STOP_PATIENCE_S)
    assert mind.on(HERE, 1.0 + STOP_PATIENCE_S) == []
    assert mind.on(HERE, 1.1 + STOP_PATIENCE_S) == [Kill("actor-easy-0")]


def test_an_actor_that_waits_to_restart_is_just_forgotten_when_scaled_down():
    mind = running({"easy": 1})
    mind.on(died("actor-easy-0"), 1.0)
    assert mind.on(Wanted(()), 1.1) == []
    assert mind.on(HERE, 5.0) == []
    assert "actor-easy-0" not in mind.wards


def test_down_and_up_again_waits_for_the_old_one_to_end():
    mind = running({"easy": 1})
    assert mind.on(Wanted(()), 1.0) == [Terminate("actor-easy-0")]
    assert mind.on(Wanted(tuple(actors({"easy": 1}))), 1.1) == []  # it still lives: no second one
    assert launched(mind.on(died("actor-easy-0", code=0), 2.0)) == ["actor-easy-0"]
    assert mind.wards["actor-easy-0"].restarts == 0
    assert mind.problems == []


def test_down_up_and_down_again_does_not_start_it():
    mind = running({"easy": 1})
    mind.on(Wanted(()), 1.0)
    mind.on(Wanted(tuple(actors({"easy": 1}))), 1.1)
    mind.on(Wanted(()), 1.2)
    assert mind.on(died("actor-easy-0", code=0), 2.0) == []


def test_a_stopping_run_is_not_scaled():
    mind = running({"easy": 1})
    mind.on(StopAsked("stopped"), 1.0)
    assert mind.on(Wanted(tuple(actors({"easy": 3}))), 1.1) == []


# Stopping


def test_a_run_stops_in_stages_and_the_router_goes_last():
    mind = running({"easy": 2})
    assert set(mind.on(StopAsked("stopped"), 1.0)) == {
        Terminate("evaluator"),
        Terminate("actor-easy-0"),
        Terminate("actor-easy-1"),
    }
    assert mind.on(HERE, 1.1) == []
    assert mind.on(died("actor-easy-0", code=0), 1.2) == []
    assert mind.on(died("evaluator", code=-15), 1.3) == []
    assert mind.on(died("actor-easy-1", code=0), 1.4) == [Terminate("learner")]
    assert mind.on(HERE, 1.5) == []
    assert mind.on(died("learner", code=0), 1.6) == [Terminate("router")]
    assert mind.on(died("router", code=0), 1.7) == [Quit("stopped", "")]


def test_each_stage_has_its_own_patience_and_is_killed_then():
    mind = running()
    mind.on(StopAsked("stopped"), 0.0)
    mind.on(died("actor-easy-0", code=0), 1.0)
    assert mind.on(HERE, STOP_PATIENCE_S) == []
    assert mind.on(HERE, STOP_PATIENCE_S + 0.1) == [Kill("evaluator")]
    now = STOP_PATIENCE_S + 1.0
    assert mind.on(died("evaluator", code=-9), now) == [Terminate("learner")]
    assert mind.on(AWAY, now + STOP_PATIENCE_S) == []
    assert mind.on(AWAY, now + STOP_PATIENCE_S + 0.1) == [Kill("learner")]


def test_silence_is_no_matter_while_stopping():
    mind = running()
    mind.on(StopAsked("stopped"), 0.0)
    assert mind.on(HERE, HANG_S + 5) == []


def test_asked_twice_everything_is_killed():
    mind = running()
    mind.on(StopAsked("stopped"), 0.0)
    orders = mind.on(StopAsked("stopped"), 0.5)
    assert set(orders) == {Kill(name) for name in ("router", "learner", "evaluator", "actor-easy-0")}
    for name in ("router", "evaluator", "learner"):
        mind.on(died(name, code=-9), 0.6)
    assert mind.on(died("actor-easy-0", code=-9), 0.6) == [Quit("stopped", "")]


def test_a_finished_run_stops_in_stages_and_says_so():
    mind = running()
    assert mind.on(StopAsked("finished"), 0.0) == [Terminate("evaluator"), Terminate("actor-easy-0")]
    assert mind.on(StopAsked("finished"), 0.1) == []  # told on every look: no reason to kill
    for name in ("evaluator", "actor-easy-0", "learner"):
        mind.on(died(name, code=0), 0.2)
    assert mind.on(died("router", code=0), 0.3) == [Quit("finished", "")]


def test_a_stop_outranks_the_finish_that_follows():
    mind = running()
    mind.on(StopAsked("stopped"), 0.0)
    assert mind.on(StopAsked("finished"), 0.1) == []
    assert mind.stopping.outcome == "stopped"


def test_who_dies_while_stopping_is_not_started_again():
    mind = running()
    mind.on(StopAsked("stopped"), 0.0)
    assert mind.on(died("learner", code=1), 0.1) == []
    assert launched(mind.on(HERE, 50.0)) == []
    mind.on(died("evaluator"), 0.2)
    assert mind.on(died("actor-easy-0"), 0.3) == [Terminate("router")]


def test_who_waits_to_restart_is_not_waited_for():
    mind = running()
    mind.on(died("learner"), 0.0)
    mind.on(died("evaluator"), 0.0)
    mind.on(died("actor-easy-0"), 0.0)
    assert mind.on(StopAsked("stopped"), 0.1) == [Terminate("router")]


def test_a_run_of_which_nothing_lives_ends_at_once():
    mind = supervisor()
    assert mind.on(StopAsked("stopped"), 0.0) == [Quit("stopped", "")]
    assert mind.on(AWAY, 0.1) == [Quit("stopped", "")]


def test_a_hung_process_does_not_hold_up_a_stop():
    mind = running()
    keep_alive(mind, 9.0, but=["evaluator"])
    assert mind.on(HERE, HANG_S + 0.1) == [Kill("evaluator")]
    mind.on(StopAsked("stopped"), 10.2)
    mind.on(died("actor-easy-0", code=0), 10.3)
    assert mind.on(died("evaluator", code=-9), 10.4) == [Terminate("learner")]


class Machine(RuleBasedStateMachine):
    """Random histories on a machine where processes beat, hang, ignore signals and die as they like."""

    @initialize(
        count=st.integers(0, 3),
        adopted=st.sets(st.sampled_from(["router", "learner", "evaluator", "actor-easy-0", "actor-easy-8"])),
        max_restarts=st.integers(0, 3),
    )
    def begin(self, count, adopted, max_restarts):
        self.now = 0.0
        self.mind = Supervisor(cluster({"easy": count}), Limits(HANG_S, max_restarts, 60.0))
        self.alive = set()
        self.asked_to_end = set()
        self.quit = None
        for name in sorted(adopted):
            self.alive.add(name)
            self.tell(Adopted(name))
        for name in sorted(self.alive - set(self.mind.wards)):  # killed as unwanted: gone before anything else
            self.tell_exit(name, -9)

    def tell(self, event):
        for order in self.mind.on(event, self.now):
            match order:
                case Launch(spec):
                    assert spec.name not in self.alive, "launched a process that is alive"
                    assert self.mind.stopping is None, "launched a process of a stopping run"
                    self.alive.add(spec.name)
                case Terminate(name) | Kill(name):
                    assert name in self.alive, "sent a signal to nobody"
                    self.asked_to_end.add(name)
                case Quit():
                    assert not self.alive, "left processes behind"
                    self.quit = order

    def tell_exit(self, name, code):
        self.alive.discard(name)
        self.asked_to_end.discard(name)
        self.tell(Exited(name, code, "words"))

    @rule(seconds=st.sampled_from([0.1, 0.5, 2.0, 11.0, 21.0, 130.0]), connected=st.booleans())
    def time_passes(self, seconds, connected):
        self.now += seconds
        self.tell(Tick(connected))

    @rule(share=st.integers(1, 3))
    def some_beat(self, share):
        for name in sorted(self.alive)[::share]:
            self.tell(Beat(name))

    @rule(data=st.data(), code=st.sampled_from([0, 1, -9, EXIT_FATAL, None]))
    def one_ends(self, data, code):
        if self.alive:
            self.tell_exit(data.draw(st.sampled_from(sorted(self.alive))), code)

    @rule(data=st.data())
    def one_turns_out_to_live_already(self, data):
        if self.alive and self.mind.stopping is None:
            self.tell(Adopted(data.draw(st.sampled_from(sorted(self.alive)))))

    @rule()
    def those_told_to_end_do(self):
        for name in sorted(self.asked_to_end):
            self.tell_exit(name, 0)

    @rule(easy=st.integers(0, 3), hard=st.integers(0, 1))
    def is_scaled(self, easy, hard):
        self.tell(Wanted(tuple(actors({"easy": easy, "hard": hard}))))

    @rule(outcome=st.sampled_from(["finished", "stopped"]))
    def is_stopped(self, outcome):
        self.tell(StopAsked(outcome))

    @invariant()
    def whoever_lives_is_looked_after(self):
        if hasattr(self, "mind"):
            assert self.alive <= set(self.mind.wards)

    @invariant()
    def a_run_that_quit_was_stopping(self):
        if getattr(self, "quit", None) is not None:
            assert self.mind.stopping == self.quit

    def teardown(self):
        """However the history went: a run that is stopped quits once all its processes have ended."""
        if not hasattr(self, "mind"):
            return
        self.tell(StopAsked("stopped"))
        for _ in range(100):
            for name in sorted(self.asked_to_end):
                self.tell_exit(name, 0)
            self.now += 5.0
            self.tell(HERE)
            if self.quit is not None:
                break
        assert self.quit is not None
        assert not self.alive


TestMachine = Machine.TestCase
TestMachine.settings = settings(
    max_examples=80, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
)
