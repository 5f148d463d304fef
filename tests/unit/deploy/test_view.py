"""What is shown of a run, as plain values."""

import pytest

from railctl.common.compile_signs import COMPILING
from railctl.common.records.control import ProcessStatus, Progress, Status
from railctl.deploy.view import SHOWN_PROBLEMS, run_view

PROGRESS = Progress(
    done=40,
    leased=1,
    waiting={"easy": 2, "hard": 3},
    weights_version=41,
    snapshot=30,
    evaluations=2,
    evaluations_due=2,
    return_last_100=-0.25,
    staleness_last_100=None,
    episodes_per_s=2.0,
    steps_per_s=100.0,
    refused=0,
    duplicates=3,
    reissued=4,
)


def process(name="learner", **changes):
    values = {
        "process": name,
        "role": name.partition("-")[0],
        "serves": None,
        "pid": 1,
        "state": "training",
        "restarts": 0,
        "last_heartbeat_unix_s": None,
    }
    return ProcessStatus(**values | changes)


def status(**changes):
    values = {
        "run": "one",
        "path": "runs/one",
        "state": "running",
        "algorithm": "ppo",
        "episodes": 100,
        "supervisor_pid": 1,
        "progress": PROGRESS,
        "time_left_s": 30.0,
        "problems": [],
        "processes": [process()],
    }
    return Status(**values | changes)


def test_episodes_that_wait_are_added_up():
    shown = run_view(status(), 0.0).progress
    assert (shown.waiting, shown.waiting_by_level) == (5, {"easy": 2, "hard": 3})


@pytest.mark.parametrize(
    ("state", "tone"),
    [("running", "good"), ("paused", "waits"), ("failed", "wrong"), ("stopped", "idle"), ("starting", "idle")],
)
def test_states_have_tones(state, tone):
    assert run_view(status(state=state), 0.0).tone == tone


def test_the_last_problems_are_shown():
    assert run_view(status(problems=list("abcde")), 0.0).problems == tuple("abcde"[-SHOWN_PROBLEMS:])


def test_a_process_has_been_silent_since_its_last_heartbeat():
    found = [process(last_heartbeat_unix_s=beat) for beat in (None, 95.0, 101.0)]
    shown = run_view(status(processes=found), 100.0)
    assert [one.silent_s for one in shown.processes] == [None, 5.0, 0.0]


def test_without_progress_it_says_what_it_does():
    assert run_view(status(progress=None, state="starting"), 0.0).starting == "starting ..."
    compiles = run_view(status(progress=None, processes=[process(state=COMPILING)]), 0.0)
    assert compiles.starting == f"learner: {COMPILING} ..."
    assert run_view(status(), 0.0).starting == ""


def test_who_has_a_pid_is_alive():
    assert run_view(status(processes=[process(), process("router", pid=None)]), 0.0).alive == 1
