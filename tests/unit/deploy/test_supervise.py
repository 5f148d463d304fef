"""What the supervisor tells machines that join; what it decides is tested with its mind."""

import errno
import os
import signal

import pytest

from railctl.common.folder import RunFolder
from railctl.common.levels.own import own_copy
from railctl.common.process import STARTING
from railctl.common.records.control import Empty, ScaleRequest
from railctl.common.records.heartbeats import Heartbeat
from railctl.common.records.joining import LevelPart, LevelPartRequest
from railctl.deploy import processes, supervise
from railctl.deploy.launch import new_run, write_cluster_file
from railctl.deploy.resolve import resolve
from railctl.deploy.supervise import Runner
from railctl.deploy.supervisor import Tick


class Asked:
    """A question, and what became of it."""

    def __init__(self, request):
        self.request = request
        self.answered = self.refused = None

    def answer(self, record):
        self.answered = record

    def refuse(self, reason):
        self.refused = reason


@pytest.fixture
def runner(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    folder = new_run("one", resolve({"episodes": 10}))
    write_cluster_file(folder, folder.config())
    before = signal.getsignal(signal.SIGCHLD)
    made = Runner(folder)
    yield made
    made._events.close()
    signal.signal(signal.SIGCHLD, before)


def test_a_run_introduces_itself_with_all_that_others_need(runner, tmp_path):
    question = Asked(Empty())
    runner._on_run(question)
    folder = RunFolder(tmp_path / "runs" / "one")
    assert (question.answered.name, question.answered.namespace) == ("one", folder.endpoint_and_namespace()[1])
    assert question.answered.config == folder.config_file.read_text()


def test_a_process_that_is_heard_before_it_runs_lives_and_starts_still(runner):
    runner._mind.on(Tick(connected=False), 0.0)
    runner._pids["learner"] = 7
    ward = runner._mind.wards["learner"]
    for state, then in ((STARTING, "starting"), ("training", "running")):
        ward.last_sign = 0.0
        runner._on_beat(Heartbeat(process="learner", role="learner", pid=7, state=state, report=None))
        assert ward.state == then
        assert ward.last_sign > 0.0


def test_the_copy_of_level_files_is_sent_in_parts(runner, tmp_path, monkeypatch):
    copy = own_copy(tmp_path / "runs" / "one", "mine")
    copy.parent.mkdir()
    copy.write_bytes(b"levels")
    monkeypatch.setattr(supervise, "PART_BYTES", 4)
    for first, content in ((0, b"leve"), (4, b"ls"), (9, b"")):
        question = Asked(LevelPartRequest(level="mine", first=first))
        runner._on_pull_levels(question)
        assert question.answered == LevelPart(content=content, total=6)


def test_level_files_that_are_not_there_are_refused(runner):
    question = Asked(LevelPartRequest(level="mine", first=0))
    runner._on_pull_levels(question)
    assert question.refused == "mine.npz: No such file or directory"
    assert question.answered is None


def failing(number):
    def fail(*_args, **_options):
        raise OSError(number, os.strerror(number))

    return fail


def test_what_the_system_does_not_start_counts_as_died(runner, monkeypatch):
    monkeypatch.setattr(processes.subprocess, "Popen", failing(errno.EAGAIN))
    runner._folder.logs.mkdir(exist_ok=True)
    runner._handle(Tick(connected=False))
    assert runner._mind.wards["learner"].state == "waiting"
    assert "learner died: starts again in 0.5 s" in runner.status().problems
    wards = runner._mind.wards["router"]
    wards.deaths = [wards.deaths[0]] * runner._config.cluster.max_restarts
    wards.since = 0.0
    runner._handle(Tick(connected=False))
    assert runner._quit.reason.endswith("it cannot be started: Resource temporarily unavailable; see logs/router.log")


def test_a_scale_that_cannot_be_kept_changes_nothing(runner, monkeypatch):
    monkeypatch.setattr(supervise, "write_atomically", failing(errno.ENOSPC))
    question = Asked(ScaleRequest(actors={"easy": 3}))
    runner._on_scale(question)
    assert not question.answered.done
    assert question.answered.text.endswith("cluster.json: No space left on device: the actors stay as they are")
    assert runner._counts == {"easy": 0}
    assert not any(name.startswith("actor") for name in runner._mind.wards)
