"""What a user does to a run, and what goes wrong."""

import json
import os
import resource
import shutil
import signal
from pathlib import Path

import pytest

from railctl.common.locks import living


def test_pause_scale_resume_checkpoint_down_up(clusters, undisturbed, tail):
    clusters.up("handled", "--detach")
    rows = tail("handled")
    rows.until(2)
    clusters.pause("handled")
    assert "paused after" in clusters.railctl("pause", "handled").stdout
    status = json.loads(clusters.railctl("status", "handled", "--json").stdout)
    assert status["state"] == "paused"
    done = status["progress"]["done"]
    clusters.railctl("scale", "handled", "easy=3")
    clusters.wait(lambda: _running_actors(clusters.status("handled")) == 3)
    clusters.railctl_here("scale", "handled", "easy=1")
    clusters.wait(lambda: "actor-easy-2" not in living(clusters.folder("handled")))
    assert clusters.status("handled")["progress"]["done"] <= done + 1  # at most the one that was being trained
    assert json.loads(clusters.railctl("resume", "handled", "--json").stdout)["done"]
    rows.until(done + 2)
    clusters.pause("handled")
    clusters.railctl("checkpoint", "handled")
    clusters.railctl("down", "handled")
    assert living(clusters.folder("handled")) == {}
    status = clusters.status("handled")
    assert status["state"] == "stopped"
    assert status["progress"]["snapshot"] == status["progress"]["done"] >= done + 2  # nothing was lost
    clusters.goes_on_paused("handled")
    tail("handled").rest()
    ours = [row for row in clusters.curve("handled") if "digest" in row or row["episode"] in (20, 40)]
    assert ours == undisturbed
    assert clusters.actors("handled") >= {"learner", "actor-easy-0"}  # who acted first, and who did in the end


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 1)])
def test_ctrl_c_and_sigterm_stop_cleanly_and_lose_nothing(clusters, tail, number, code):
    name = f"interrupted-{number}"
    interrupt(clusters, tail, name, number, code)
    status = clusters.status(name)
    assert status["state"] == "stopped"
    assert status["progress"]["snapshot"] == status["progress"]["done"] >= 2


@pytest.mark.slow
def test_a_second_run_goes_on_where_ctrl_c_stopped_the_first(clusters, undisturbed, tail):
    interrupt(clusters, tail, "interrupted-once")
    clusters.goes_on_paused("interrupted-once")
    tail("interrupted-once").rest()
    assert clusters.curve("interrupted-once") == undisturbed


def interrupt(clusters, tail, name, number=signal.SIGINT, code=0):
    """Start a run, and stop it after some episodes with Ctrl-C, or as a batch system does."""
    foreground = clusters.start("up", "--name", name, *clusters.options)
    clusters.wait(clusters.folder(name).episodes_file.exists)
    tail(name).until(2)
    clusters.pause(name)  # or it may be over before it is interrupted
    foreground.send_signal(number)
    output, errors = foreground.communicate(timeout=60)
    assert foreground.returncode == code, errors
    assert "stopping cleanly" in output
    assert f"railctl up --name {name} goes on" in (errors if code else output)
    assert living(clusters.folder(name)) == {}


@pytest.mark.slow
def test_a_second_up_attaches_and_another_configuration_is_refused(clusters, tail):
    clusters.up("twice", "--detach")
    tail("twice").until(1)
    clusters.pause("twice")
    before = living(clusters.folder("twice"))
    assert "is running already" in clusters.up("twice", "--detach").stdout
    assert living(clusters.folder("twice"))["supervisor"] == before["supervisor"]
    refused = clusters.railctl("up", "--name", "twice", "--episodes", "99", code=2)
    assert "episodes 40, not 99" in refused.stderr
    assert "no level hard" in clusters.railctl_here("scale", "twice", "hard=1", code=1).stderr
    clusters.railctl("down", "twice", "--force")
    assert living(clusters.folder("twice")) == {}


@pytest.mark.slow
def test_a_damaged_snapshot_ends_the_run_with_its_name(clusters, tail):
    clusters.up("damaged", "--detach")
    rows = tail("damaged")
    rows.until(5)
    clusters.pause("damaged")
    newest = max(clusters.folder("damaged").snapshots.glob("*.safetensors"))
    content = bytearray(newest.read_bytes())
    content[-1] ^= 1
    newest.write_bytes(content)
    clusters.kill("damaged", "learner")
    rows.rest()
    status = clusters.status("damaged")
    assert status["state"] == "failed"
    assert newest.name in status["problems"][0]
    assert living(clusters.folder("damaged")) == {}
    refused = clusters.railctl("up", "--name", "damaged", code=1)
    assert newest.name in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1
    assert living(clusters.folder("damaged")) == {}


@pytest.mark.slow
def test_a_full_disk_ends_the_run_in_a_line(clusters, tail):
    clusters.up("full", "--detach")
    rows = tail("full")
    rows.until(1)
    clusters.pause("full")
    learner = living(clusters.folder("full"))["learner"]
    resource.prlimit(
        learner, resource.RLIMIT_FSIZE, (100_000, 100_000)
    )  # rows and logs fit, the next snapshot does not
    clusters.railctl("resume", "full")
    rows.rest()
    status = clusters.status("full")
    assert (status["state"], living(clusters.folder("full"))) == ("failed", {})
    [problem] = status["problems"]
    remedy = "File too large: make room, then railctl up --name full goes on"
    assert problem == f"learner cannot go on: {clusters.folder('full').path}: {remedy}"


def test_a_run_whose_folder_is_deleted_leaves_no_process(clusters, tail):
    clusters.up("deleted", "--detach")
    tail("deleted").until(2)
    clusters.pause("deleted")
    clusters.kill("deleted", "supervisor")
    folder = clusters.folder("deleted")
    clusters.wait(lambda: "supervisor" not in living(folder))
    foreground = clusters.start("up", "--name", "deleted")
    clusters.wait(lambda: clusters.status("deleted")["state"] == "paused")  # its processes are adopted
    processes = living(folder).values()
    endpoint, _ = folder.endpoint_and_namespace()
    clusters.wait(lambda: not shutil.rmtree(folder.path, ignore_errors=True) and not folder.path.exists())
    _, errors = foreground.communicate(timeout=60)
    assert foreground.returncode == 1
    assert errors == f"railctl: {folder.path} is gone, and so its processes end\n"
    clusters.wait(lambda: not any(Path(f"/proc/{pid}").exists() for pid in processes))
    assert not Path(endpoint.removeprefix("unixsock-stream/")).exists()


@pytest.mark.slow
def test_nor_does_one_whose_supervisor_had_been_killed(clusters, tail):
    clusters.up("orphaned", "--actors", "easy=1", "--detach")
    tail("orphaned").until(2)
    folder = clusters.folder("orphaned")
    processes = living(folder)
    clusters.kill("orphaned", "supervisor")
    clusters.wait(lambda: not shutil.rmtree(folder.path, ignore_errors=True) and not folder.path.exists())
    assert {"router", "learner", "actor-easy-0"} <= processes.keys()
    clusters.wait(lambda: not any(Path(f"/proc/{pid}").exists() for pid in processes.values()))


@pytest.mark.slow
def test_up_without_a_reader_fails_and_its_run_goes_on(clusters):
    foreground = clusters.start("up", "--name", "unread", *clusters.options, "--episodes", "100000")
    assert foreground.stdout.readline()
    foreground.stdout.close()
    said = "nobody reads this any more; run unread goes on: railctl tail unread follows it"
    with foreground.stderr as complaints:
        assert complaints.read() == f"railctl: {said}\n"
    assert foreground.wait(60) == 1
    assert "supervisor" in living(clusters.folder("unread"))
    clusters.railctl("down", "unread", "--force")


@pytest.mark.slow
def test_a_process_that_keeps_dying_ends_the_run(clusters, tail):
    clusters.up("dying", "--set", "cluster.max_restarts=1", "--detach")
    rows = tail("dying")
    rows.until(1)
    folder = clusters.folder("dying")
    for _ in range(2):
        clusters.wait(lambda: "evaluator" in living(folder))
        pid = living(folder)["evaluator"]
        os.kill(pid, signal.SIGKILL)
        clusters.wait(lambda pid=pid: living(folder).get("evaluator") != pid)
    rows.rest()
    assert "evaluator died (signal 9) 2 times" in clusters.status("dying")["problems"][0]
    assert living(folder) == {}


def test_a_checkpoint_is_scored_as_in_its_run(clusters, undisturbed):
    for row in undisturbed[-2:]:
        path = clusters.folder("undisturbed").checkpoints / f"{row['episode']:08d}.safetensors"
        document = json.loads(clusters.railctl("evaluate", str(path), "--episodes", "2", "--json").stdout)
        [found] = document["rows"]
        assert (document["episode"], found["level"], found["levels"]) == (row["episode"], row["level"], row["levels"])
        ours = [found[name] for name in ("mean", "arrived_share", "all_arrived_share", "mean_steps")]
        assert ours == [row[name] for name in ("return", "arrived_share", "all_arrived_share", "mean_steps")]


def test_doctor_finds_this_machine_fit(clusters):
    report = json.loads(clusters.railctl("doctor", "--json").stdout)
    assert report["ok"], report
    assert {check["check"] for check in report["checks"]} >= {"python", "packages", "zenoh", "arithmetic"}


def _running_actors(status):
    return sum(process["role"] == "actor" and process["state"] != "starting" for process in status["processes"])
