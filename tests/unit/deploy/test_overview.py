"""The status of a run, put together from wards and heartbeats."""

import os
from pathlib import Path

import pytest
from learner_report import LEARNER

from railctl.common.folder import RunFolder
from railctl.common.records.control import ProcessStatus, Status
from railctl.common.records.heartbeats import EvaluatorReport, Heartbeat
from railctl.common.wire.codec import decode, encode, encoding_of
from railctl.deploy.overview import overview, progress_of, run_is_complete
from railctl.deploy.plan import cluster
from railctl.deploy.resolve import resolve
from railctl.deploy.supervisor import Beat, Exited, Limits, StopAsked, Supervisor, Tick, Wanted

CONFIG = resolve({"mix": {"easy": 0.5, "hard": 0.5}, "episodes": 100, "evaluation": {"every_episodes": 50}})
PIDS = {"router": 10, "learner": 11, "evaluator": 12, "actor-easy-0": 13, "actor-hard-0": 14}


def beat(process, state="training", report=None):
    role = process.partition("-")[0]
    return Heartbeat(process=process, role=role, pid=PIDS.get(process, 1), state=state, report=report), 1000.0


def beats(learner_state="training", evaluations=4, **changes):
    return {
        "learner": beat("learner", learner_state, LEARNER.model_copy(update=changes)),
        "evaluator": beat("evaluator", "evaluating", EvaluatorReport(evaluations=evaluations)),
    }


def running(counts=None):
    mind = Supervisor(cluster(counts or {"easy": 1, "hard": 1}), Limits(60.0, 5, 120.0))
    for _ in range(2):  # the evaluator starts when the learner has come
        mind.on(Tick(connected=True), 0.0)
        for name in mind.wards:
            mind.on(Beat(name), 0.0)
    return mind


def status(mind=None, said=None, config=CONFIG):
    found = overview(RunFolder(Path("runs/one")), config, mind or running(), PIDS, beats() if said is None else said)
    assert decode(Status, encoding_of(Status), encode(found)) == found  # it can travel
    return found


def test_the_whole_picture():
    found = status()
    assert (found.run, found.path, found.algorithm, found.episodes) == ("one", "runs/one", "dddqn", 100)
    assert (found.state, found.supervisor_pid, found.time_left_s) == ("running", os.getpid(), 30.0)
    progress = found.progress
    assert (progress.done, progress.leased, progress.snapshot, progress.weights_version) == (40, 1, 30, 41)
    assert (progress.evaluations, progress.evaluations_due) == (4, 4)  # two checkpoints of two difficulties
    assert (progress.episodes_per_s, progress.steps_per_s, progress.return_last_100) == (2.0, 100.0, None)
    assert (progress.refused, progress.duplicates, progress.reissued) == (0, 3, 4)
    assert progress.waiting == {}
    assert found.problems == []
    assert [(p.process, p.role, p.serves, p.pid, p.state) for p in found.processes] == [
        ("router", "router", None, 10, "running"),
        ("learner", "learner", None, 11, "training"),
        ("evaluator", "evaluator", None, 12, "evaluating"),
        ("actor-easy-0", "actor", "easy", 13, "running"),
        ("actor-hard-0", "actor", "hard", 14, "running"),
    ]
    assert [p.last_heartbeat_unix_s for p in found.processes] == [None, 1000.0, 1000.0, None, None]


@pytest.mark.parametrize(
    "said", [{}, {"evaluator": beat("evaluator", report=EvaluatorReport(evaluations=1))}, {"learner": beat("learner")}]
)
def test_before_the_learners_first_word_there_is_no_progress(said):
    found = status(said=said)
    assert (found.state, found.progress, found.time_left_s) == ("starting", None, None)
    assert progress_of(CONFIG, said) is None
    assert not run_is_complete(CONFIG, said)


@pytest.mark.parametrize(
    ("said", "state"),
    [
        (beats(), "running"),
        (beats("paused"), "paused"),
        (beats("finished", done=100), "finishing"),
        (beats("paused", done=100), "finishing"),
    ],
)
def test_the_state_is_what_the_learner_tells(said, state):
    assert status(said=said).state == state


def test_a_stopping_run_says_so_whatever_the_learner_tells():
    mind = running()
    mind.on(StopAsked("stopped"), 1.0)
    assert status(mind, beats("paused")).state == "stopping"
    assert status(mind, {}).state == "stopping"


def test_time_left_needs_a_speed():
    assert status(said=beats(episodes_per_s=0.0)).time_left_s is None
    assert status(said=beats(done=100)).time_left_s == 0.0


def test_returns_are_told_as_they_are():
    assert status(said=beats(return_last_100=-0.25)).progress.return_last_100 == -0.25


def test_waiting_episodes_are_told_and_a_concern_if_nobody_serves_them():
    said = beats(waiting={"easy": 1, "hard": 2})
    found = status(said=said)
    assert found.progress.waiting == {"easy": 1, "hard": 2}
    assert found.problems == []
    mind = running({"easy": 1})
    assert status(mind, said).problems == [
        "2 hard episodes wait and no actor serves hard: railctl scale RUN hard=1",
    ]
    assert status(running({"any": 1}), said).problems == []
    mind.on(Wanted(()), 1.0)
    mind.on(Exited("actor-easy-0", 0, ""), 2.0)
    assert len(status(mind, said).problems) == 2


def test_refused_messages_are_a_concern():
    assert status(said=beats(refused=5)).problems == [
        "5 messages were refused: railctl logs RUN learner says why",
    ]


def test_the_end_of_exactness_is_a_concern():
    assert status(said=beats(exact_until=30)).problems == [
        "resumed at episode 30 on another machine or torch: exactness ends there",
    ]


def test_a_process_that_waits_to_restart_says_so():
    mind = running()
    mind.on(Exited("learner", 1, ""), 1.0)
    pids = {name: pid for name, pid in PIDS.items() if name != "learner"}
    found = overview(RunFolder(Path("runs/one")), CONFIG, mind, pids, beats())
    [learner] = [process for process in found.processes if process.process == "learner"]
    assert (learner.state, learner.restarts, learner.pid) == ("waiting to restart", 1, None)
    assert found.problems == ["learner died (exit code 1): starts again in 0.5 s"]


def test_a_process_that_does_not_run_is_not_said_to_do_what_it_did_last():
    mind = running()
    mind.on(Exited("evaluator", 1, ""), 1.0)
    mind.on(Tick(connected=True), 2.0)
    found = status(mind)
    [evaluator] = [process for process in found.processes if process.process == "evaluator"]
    assert evaluator.state == "starting"


def test_many_and_long_problems_still_travel():
    mind = running()
    mind.problems = ["x" * 10_000] * 100
    said = beats(refused=5, exact_until=1, waiting={"easy": 1, "hard": 1})
    found = status(mind, said)
    assert len(found.problems) <= 100
    assert found.problems[-1].startswith("resumed at episode 1")


@pytest.mark.parametrize(
    ("done", "evaluations", "complete"),
    [(100, 4, True), (100, 3, False), (99, 4, False), (100, 5, True)],
)
def test_a_run_is_complete_when_all_is_trained_and_evaluated(done, evaluations, complete):
    assert run_is_complete(CONFIG, beats(done=done, evaluations=evaluations)) is complete


def test_a_run_without_an_evaluators_word_is_not_complete():
    said = beats(done=100)
    del said["evaluator"]
    assert not run_is_complete(CONFIG, said)


def test_actors_of_other_machines_are_shown_beside_ours_and_serve():
    far = ProcessStatus(
        process="actor-node7-hard-0",
        role="actor",
        serves="hard",
        pid=3,
        state="acting episode 4",
        restarts=0,
        last_heartbeat_unix_s=1000.0,
    )
    mind, said = running({"easy": 1}), beats(waiting={"hard": 2})
    alone = overview(RunFolder(Path("runs/one")), CONFIG, mind, PIDS, said)
    joined = overview(RunFolder(Path("runs/one")), CONFIG, mind, PIDS, said, [far])
    assert alone.problems == ["2 hard episodes wait and no actor serves hard: railctl scale RUN hard=1"]
    assert joined.problems == []
    assert joined.processes == [*alone.processes, far]
