"""A study whose numbers are the same, whatever is killed on the way."""

import json
import os
import shutil
import signal
from pathlib import Path

import pytest
import yaml

from railctl.analysis.study import StudyFolder, planned_runs, read_study
from railctl.common.folder import RunFolder
from railctl.common.locks import holder, living

PER = {"replay": "prioritized", "dqn": {"batch_size": 32, "learn_every_steps": 2}}
STUDY = {
    "contenders": [  # they learn much, or they would be over before anybody can disturb them
        {"name": "per", "algorithm": "dddqn", "settings": PER},
        {"name": "ppo", "algorithm": "ppo", "settings": {"ppo": {"epochs": 40}}},
    ],
    "levels": ["easy"],
    "seeds": [3],
    "episodes": 12,
    "settings": {"evaluation": {"every_episodes": 12, "levels": 2}, "cluster": {"snapshot_every_episodes": 4}},
    "evaluation": {"episodes": 5},
    "references": ["random"],
    "judgement": {"block": 4},
}
NOT_OF_THE_CURVE = {"actor", "acting_s", "trained_unix_s", "evaluated_unix_s", "evaluating_s"}


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    path = tmp_path_factory.mktemp("studies") / "small.yaml"
    path.write_text(yaml.safe_dump(STUDY))
    return path


def folder_of(clusters, name) -> StudyFolder:
    return StudyFolder(clusters.root / name)


def numbers(folder: StudyFolder) -> dict[str, object]:
    """All that a study comes to, without who did it and when."""
    found: dict[str, object] = {}
    for run in planned_runs(read_study(folder.study_file)):
        place = RunFolder(folder.run(run))
        lines = [*place.episodes_file.read_text().splitlines(), *place.evaluations_file.read_text().splitlines()]
        found[run.name] = [{k: v for k, v in json.loads(line).items() if k not in NOT_OF_THE_CURVE} for line in lines]
    scores = [*folder.path.glob("evaluations/*.json"), *folder.path.glob("references/*.json")]
    return found | {path.name: path.read_text() for path in scores}


def kill_all_of(clusters, folder: StudyFolder) -> None:
    """The command, supervisors, learners, actors: everything at once."""
    runs = [RunFolder(path.parent) for path in folder.runs.glob("*/config.yaml")]
    for pid in [holder(folder, "study"), *(pid for run in runs for pid in living(run).values())]:
        if pid is not None:
            os.kill(pid, signal.SIGKILL)
    clusters.wait(lambda: not any(living(run) for run in runs))


@pytest.fixture(scope="module")
def left_alone(clusters, described):
    output = clusters.railctl("study", "run", str(described)).stdout
    folder = folder_of(clusters, "small")
    assert "2 of 2 runs done, 24 of 24 episodes" in output
    assert f"report   {folder.report}" in output
    return numbers(folder)


def hold(clusters, folder: StudyFolder, names=("per-easy-3", "ppo-easy-3")) -> list[RunFolder]:
    """Wait until the runs are under way, and pause them."""
    runs = [RunFolder(folder.runs / name) for name in names]
    going = list(runs)

    def all_are_held() -> bool:
        for run in [run for run in going if has_rows(run, 2)]:  # at once, or it is over while another one begins
            clusters.pause(str(run.path))
            going.remove(run)
        return not going

    clusters.wait(all_are_held)
    return runs


def has_rows(run: RunFolder, count: int) -> bool:
    return run.episodes_file.exists() and run.episodes_file.read_text().count("\n") >= count


def let_go(clusters, runs: list[RunFolder]) -> None:
    """Have runs go on that live and are paused."""
    for run in runs:
        clusters.wait(lambda run=run: clusters.status(str(run.path))["state"] == "paused")
        clusters.tell_learner(str(run.path), "resume")


def test_a_study_comes_to_the_same_numbers_whatever_is_killed(clusters, described, left_alone):
    assert {"per-easy-3", "ppo-easy-3", "per-easy-3.json", "ppo-easy-3.json", "random-easy.json"} == set(left_alone)
    run, folder = ("study", "run", str(described), "--name", "study-killed"), folder_of(clusters, "study-killed")

    command = clusters.start(*run)
    runs = hold(clusters, folder)
    assert "works on study study-killed already" in clusters.railctl_here(*run, code=1).stderr
    status = json.loads(clusters.railctl_here("study", "status", "study-killed", "--json").stdout)
    assert (status["process"], status["runs_done"]) == (command.pid, 0)
    command.kill()
    command.communicate()

    command = clusters.start(*run)  # adopts what lives
    clusters.wait(lambda: holder(folder, "study") == command.pid)
    let_go(clusters, runs)
    kill_all_of(clusters, folder)
    command.communicate()

    clusters.railctl(*run)
    assert numbers(folder) == left_alone
    for one in runs:  # started at the beginning, and when all had been killed
        log = (one.logs / "supervisor.log").read_text()
        assert log.count("supervises") <= 2
        assert "runs already" not in log
    assert not list(folder.runs.glob("*/snapshots/*"))  # runs that are over go nowhere
    assert "is finished" in clusters.railctl_here("up", "--name", "study-killed/runs/ppo-easy-3").stdout


def test_what_was_done_elsewhere_is_not_done_again(clusters, described, left_alone, tmp_path):
    """Of two runs one comes from a machine that is gone; the other is trained here, and both are reported on."""
    elsewhere, published = folder_of(clusters, "study-elsewhere"), tmp_path / "published"
    shutil.copytree(folder_of(clusters, "small").path, elsewhere.path)
    shutil.rmtree(elsewhere.runs / "ppo-easy-3")
    told = clusters.railctl("study", "publish", "study-elsewhere", "--output", str(published)).stdout
    assert "of 1 of 2 runs; the others are not done" in told
    run = ("study", "run", str(described), "--name", "study-here")
    clusters.railctl(*run, "--from", str(published))
    here = folder_of(clusters, "study-here")
    assert [path.name for path in here.runs.iterdir()] == ["ppo-easy-3"]
    assert not list(here.path.glob("references/*"))
    assert "2 of 2 runs done, 24 of 24 episodes" in clusters.railctl_here("study", "status", "study-here").stdout
    reports = [
        json.loads((folder_of(clusters, name).report / "report.json").read_text()) for name in ("small", "study-here")
    ]
    assert reports[0]["runs"] == reports[1]["runs"]
    assert reports[0]["tables"]["table-5.2"] == reports[1]["tables"]["table-5.2"]
    refused = clusters.railctl_here("study", "run", "thesis-mini", "--from", str(published), code=2).stderr
    assert "these are results of another study (small): leave it out" in refused


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 1)])
def test_a_signal_stops_cleanly_and_is_told_how_to_go_on(clusters, described, left_alone, number, code):
    run = ("study", "run", str(described), "--name", f"study-stopped-{code}")
    folder = folder_of(clusters, f"study-stopped-{code}")
    command = clusters.start(*run)
    runs = hold(clusters, folder)
    command.send_signal(number)
    output, errors = command.communicate(timeout=60)
    assert command.returncode == code, errors
    assert f"stopped; railctl study run {described} --name study-stopped-{code} goes on" in (errors if code else output)
    assert not any(map(living, runs))
    for one in runs:
        one.paused_file.unlink()
    clusters.railctl(*run)
    assert numbers(folder) == left_alone


@pytest.mark.slow
def test_a_run_that_cannot_go_on_stops_no_other(clusters, described, left_alone):
    folder = folder_of(clusters, "small")
    damaged: Path = folder.runs / "ppo-easy-3"
    (folder.path / "evaluations" / "ppo-easy-3.json").unlink()
    rows = (damaged / "episodes.jsonl").read_text()
    (damaged / "outcome.json").unlink()
    (damaged / "episodes.jsonl").write_text("nonsense\n" + rows)
    failed = clusters.railctl("study", "run", str(described), code=1)
    assert f"! ppo-easy-3: {damaged / 'episodes.jsonl'} line 1 is not a valid row" in failed.stdout
    assert "1 of study small failed: railctl study run" in failed.stderr
    assert "1 of 2 runs done, 1 failed" in clusters.railctl_here("study", "status", "small").stdout
    (damaged / "episodes.jsonl").write_text(rows)
    clusters.railctl("study", "run", str(described))
    assert numbers(folder) == left_alone  # without a snapshot it began anew
