"""Histories of a study: what happened, and what has to be done about it."""

from hypothesis import given
from hypothesis import strategies as st

from railctl.analysis.study import PlannedRun, Study
from railctl.deploy.study.dispatcher import (
    MOST_LOSSES,
    Adopted,
    Begin,
    Comparing,
    Dispatcher,
    Ended,
    Quit,
    Reporting,
    Scoring,
    Start,
    Stop,
    StopAsked,
    in_order,
)

A1, B1, A2 = PlannedRun("a", "easy", 1), PlannedRun("b", "easy", 1), PlannedRun("a", "easy", 2)
PLANNER = Comparing("planner", "easy")
REPORT = Reporting()
JOBS = [Scoring(A1), Scoring(B1), Scoring(A2), A1, B1, A2, PLANNER, REPORT]
STUDY = Study.model_validate(
    {
        "name": "s",
        "contenders": ["a", "b"],
        "levels": ["easy"],
        "seeds": [1, 2],
        "episodes": 30,
        "references": ["planner"],
        "judgement": {"block": 10},
    }
)


def test_every_core_has_a_job_and_the_report_comes_last():
    mind = Dispatcher(JOBS, cores=2)
    assert mind.on(Begin()) == [Start(A1), Start(B1)]
    assert mind.on(Ended(B1, "done")) == [Start(Scoring(B1))]  # at once: what is done is whole
    assert mind.on(Ended(Scoring(B1), "done")) == [Start(A2)]
    assert mind.on(Ended(A1, "done")) == [Start(Scoring(A1))]
    assert mind.on(Ended(Scoring(A1), "done")) == [Start(PLANNER)]  # fills the gap while the last run goes on
    assert mind.on(Ended(PLANNER, "done")) == []
    assert mind.on(Ended(A2, "done")) == [Start(Scoring(A2))]
    assert mind.on(Ended(Scoring(A2), "done")) == [Start(REPORT)]
    assert mind.on(Ended(REPORT, "done")) == [Quit()]


def test_a_failed_run_stops_no_other_and_is_not_scored():
    mind = Dispatcher(JOBS, cores=1)
    assert mind.on(Begin()) == [Start(A1)]
    assert mind.on(Ended(A1, "failed", "no disk")) == [Start(B1)]
    for job, after in ((B1, Scoring(B1)), (Scoring(B1), A2), (A2, Scoring(A2)), (Scoring(A2), PLANNER)):
        assert mind.on(Ended(job, "done")) == [Start(after)]
    assert mind.on(Ended(PLANNER, "failed", "no such policy")) == [Start(REPORT)]
    assert mind.on(Ended(REPORT, "done")) == [Quit()]
    assert mind.failures == {A1: "no disk", PLANNER: "no such policy"}
    assert mind.states[Scoring(A1)] == "waiting"


def test_what_was_done_or_goes_on_is_not_started_again():
    mind = Dispatcher(JOBS, cores=2)
    assert mind.on(Ended(A1, "done")) == []
    assert mind.on(Ended(Scoring(A1), "done")) == []
    assert mind.on(Adopted(B1)) == []
    assert mind.on(Begin()) == [Start(A2)]


def test_more_adopted_runs_than_cores_leave_no_core_free():
    mind = Dispatcher(JOBS, cores=1)
    mind.on(Adopted(A1))
    mind.on(Adopted(B1))
    assert mind.on(Begin()) == []
    assert mind.on(Ended(A1, "done")) == []
    assert mind.on(Ended(B1, "done")) == [Start(Scoring(A1))]


def test_a_run_without_supervisor_is_taken_up_a_few_times():
    mind = Dispatcher(JOBS, cores=1)
    mind.on(Begin())
    for _ in range(MOST_LOSSES):
        assert mind.on(Ended(A1, "lost")) == [Start(A1)]
    assert mind.on(Ended(A1, "lost")) == [Start(B1)]
    assert mind.failures == {A1: "its supervisor was killed 4 times"}


def test_a_stop_ends_what_goes_on_and_counts_as_no_failure():
    mind = Dispatcher(JOBS, cores=2)
    mind.on(Begin())
    assert mind.on(StopAsked()) == [Stop(A1), Stop(B1)]
    assert mind.on(Ended(A1, "failed", "it was stopped")) == []
    assert mind.on(StopAsked()) == [Stop(B1)]  # asked again: at once
    assert mind.on(Ended(B1, "lost")) == [Quit()]
    assert mind.failures == {}
    assert mind.states[A1] == mind.states[B1] == "waiting"


def test_a_stop_before_anything_goes_on_is_the_end():
    assert Dispatcher(JOBS, cores=2).on(StopAsked()) == [Quit()]


def test_the_longest_runs_of_a_seed_come_first_and_what_lives_before_all():
    runs = [
        job for job in in_order(STUDY, {("a", "easy"): 5.0, ("b", "easy"): 9.0}, {A2}) if isinstance(job, PlannedRun)
    ]
    assert runs == [A2, B1, A1, PlannedRun("b", "easy", 2)]
    jobs = in_order(STUDY, {("b", "easy"): 9.0}, set())
    assert [job for job in jobs if isinstance(job, PlannedRun)][:2] == [A1, B1]  # of a nothing is known
    assert jobs[-2:] == [PLANNER, REPORT]


@given(st.data(), st.integers(1, 4))
def test_whatever_happens_all_is_done_or_failed_and_no_core_has_two_jobs(data, cores):
    mind = Dispatcher(in_order(STUDY, {}, set()), cores)
    orders = mind.on(Begin())
    started = []
    while orders != [Quit()]:
        started += [order.job for order in orders]
        running = mind.running()
        assert 0 < len(running) <= cores
        job = data.draw(st.sampled_from(running))
        orders = mind.on(Ended(job, data.draw(st.sampled_from(["done", "failed", "lost"])), "why"))
    for job, state in mind.states.items():
        blocked = isinstance(job, Scoring) and mind.states[job.run] == "failed"
        assert state == ("waiting" if blocked else "failed" if job in mind.failures else "done")
    assert started.index(REPORT) > max(map(started.index, set(started) - {REPORT}))
