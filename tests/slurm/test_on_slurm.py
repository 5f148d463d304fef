"""What `railctl place` prints, carried out by Slurm on two nodes: the curve of a run that was left alone."""

import json
import re

import pytest
import yaml
from slurm_site import PATIENCE_S, free_ports

from railctl.analysis.study import StudyFolder
from railctl.common.folder import RunFolder
from railctl.common.records.control import LearnerCommand
from railctl.common.wire import keys
from railctl.deploy.launch import new_run
from railctl.deploy.resolve import parse_sets, resolve
from railctl.deploy.runs import reach

pytestmark = pytest.mark.slurm

SETTINGS = [
    "evaluation.every_episodes=15",
    "evaluation.levels=2",
    "cluster.snapshot_every_episodes=4",
    "dqn.batch_size=32",
    "dqn.learn_every_steps=8",
    "fragment_steps=null",
]
EPISODES = 30
OPTIONS = ["--level", "easy", "--episodes", str(EPISODES), "--seed", "7", "--lag", "3"]
OPTIONS += [word for setting in SETTINGS for word in ("--set", setting)]
FAR = re.compile(r"actor-\S+-\d+-easy-0")
STUDY = {
    "contenders": ["dddqn"],
    "levels": ["easy"],
    "seeds": [3, 4, 5],
    "episodes": 12,
    "settings": {"evaluation": {"every_episodes": 12, "levels": 2}},
    "evaluation": {"episodes": 5},
    "references": ["random"],
    "judgement": {"block": 4},
}


@pytest.fixture(scope="module")
def undisturbed(site):
    """The curve of the same run on one machine, without Slurm."""
    site.railctl("up", "--name", "undisturbed", *OPTIONS)
    curve = site.curve("undisturbed")
    assert len(curve) == EPISODES + 2
    return curve


def submit_held(site, name):
    """Submit a run over two nodes, which is paused until `resume`, and wait until the second one has joined it."""
    given = {"level": "easy", "episodes": EPISODES, "seed": 7, "lag": 3} | parse_sets(SETTINGS)
    new_run(name, resolve(given), site.runs).paused_file.touch()
    port = str(free_ports(1)[0])
    placed = ("place", "slurm", "--nodes", "2", "--actors-per-node", "easy=1", "--port", port, "--name", name)
    job = site.submit(site.railctl(*placed, *OPTIONS))
    site.wait(lambda: has_joined(site, name))
    return job


def has_joined(site, name, times=1):
    """The second node has come so often, as the learner sees it."""
    log = RunFolder(site.runs / name).logs / "learner.log"
    return log.exists() and len(re.findall(rf"{FAR.pattern} [0-9a-f]+ came", log.read_text())) == times


def wait_for_end(site, name, outcome, job, state):
    """Wait for the end of a run, and then of its job: a file costs less to look at again and again than a queue."""
    file = RunFolder(site.runs / name).outcome_file
    site.wait(file.exists)
    assert json.loads(file.read_text())["outcome"] == outcome
    site.wait(lambda: site.state(job) == state)


def resume(site, name):
    with reach(RunFolder(site.runs / name)) as bus:
        assert bus.ask(keys.COMMAND_LEARNER, LearnerCommand(verb="resume"), PATIENCE_S).done


def actors(site, name):
    return {json.loads(row)["actor"] for row in RunFolder(site.runs / name).episodes_file.read_text().splitlines()}


def test_a_run_over_two_nodes_has_the_curve_of_one_machine(site, undisturbed):
    job = submit_held(site, "two-nodes")
    resume(site, "two-nodes")
    wait_for_end(site, "two-nodes", "finished", job, "COMPLETED")
    assert site.curve("two-nodes") == undisturbed
    assert any(FAR.fullmatch(actor) for actor in actors(site, "two-nodes"))
    assert not list(site.runs.glob(".slurm-*"))  # its keys are gone


def test_a_job_whose_time_is_up_goes_back_into_the_queue_and_goes_on(site, undisturbed):
    job = submit_held(site, "requeued")
    site.run("scancel", "--batch", "--signal=USR1", job)  # as Slurm does before the limit
    wait_for_end(site, "requeued", "stopped", job, "PENDING")
    site.run("scontrol", "update", f"JobId={job}", "StartTime=now")  # or it waits for two minutes
    site.wait(lambda: has_joined(site, "requeued", 2))
    resume(site, "requeued")
    wait_for_end(site, "requeued", "finished", job, "COMPLETED")
    assert site.curve("requeued") == undisturbed


def test_a_job_that_is_cancelled_ends_cleanly_and_stays_out_of_the_queue(site):
    job = submit_held(site, "cancelled")
    site.run("scancel", "--batch", "--signal=TERM", job)
    wait_for_end(site, "cancelled", "stopped", job, "FAILED")


def test_an_array_of_jobs_does_a_study_between_them(site, tmp_path):
    described = tmp_path / "shared.yaml"
    described.write_text(yaml.safe_dump(STUDY))
    job = site.submit(site.railctl("study", "place", str(described), "--shares", "2", "--cores", "1"))
    folder = StudyFolder(site.runs / "shared")
    site.wait(lambda: len([*folder.path.glob("evaluations/*.json"), *folder.path.glob("references/*.json")]) == 4)
    site.wait(lambda: site.state(job).split() == ["COMPLETED"] * 2)
    logs = [(site.folder / f"shared-{job}_{task}.log").read_text() for task in (1, 2)]
    trained = [set(re.findall(r"dddqn-easy-\d: trained", log)) for log in logs]
    assert [len(runs) for runs in trained] == [2, 1]
    assert len(trained[0] | trained[1]) == len(STUDY["seeds"])
    assert "share 1/2 is done; once all are, railctl study report shared makes the report" in logs[0]
    assert not folder.report.exists()
    status = json.loads(site.railctl("study", "status", "shared", "--json"))
    assert (status["runs_done"], [reference["done"] for reference in status["references"]]) == (3, [True])
    site.railctl("study", "report", "shared")
    assert (folder.report / "report.json").exists()
