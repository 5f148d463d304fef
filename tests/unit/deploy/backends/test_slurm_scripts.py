"""Batch scripts, carried out by bash with programs that stand for Slurm's and ours; `tests/slurm` has the real ones."""

import os
import signal
import subprocess
from pathlib import Path

import pytest
import yaml

from railctl.deploy.backends.slurm import run_script, study_script
from railctl.deploy.follow import wait_until
from railctl.deploy.placement import StudyPlacement, placed

PATIENCE_S = 60.0
STOOD_FOR = """#!/bin/bash
# Tells of its call; `up`, `study` and `srun` go on until SIGTERM if they are to be held, `up` until others join if not.
echo "$(basename "$0") $*" >> "$CALLS"
if [ "$1" = up ]; then
    cp "$3" "$CALLS.run.yaml"
    until grep -q "^srun " "$CALLS"; do sleep 0.01; done
fi
if [ -n "$HELD" ] && [[ "$(basename "$0") $1" =~ ^(railctl (up|study)|srun ) ]]; then
    trap 'kill $!; echo "$(basename "$0") ended" >> "$CALLS"; exit 1' TERM
    sleep 600 &
    touch "$CALLS.$(basename "$0")"
    wait $!
fi
exit "${CODE:-0}"
"""


@pytest.fixture
def runs(tmp_path):
    return tmp_path / "my runs"


@pytest.fixture
def run(runs):
    given = {"lag": 3, "episodes": 30}
    return run_script(placed(given, Path(), "demo", 4, {"easy": 2}, 7447), runs)


@pytest.fixture
def study(runs):
    return study_script(StudyPlacement("my study.yaml", "mine", 8, 2), runs)


class Bash:
    """Carries out a script."""

    def __init__(self, folder, script, **environment):
        self.calls_file = folder / "calls"
        (folder / "bin").mkdir()
        for name in ("railctl", "srun", "scontrol"):
            path = folder / "bin" / name
            path.write_text(STOOD_FOR)
            path.chmod(0o755)
        known = {"CALLS": str(self.calls_file), "PATH": f"{folder}/bin:{os.environ['PATH']}", "HELD": ""}
        known |= {
            "SLURM_JOB_ID": "17",
            "SLURM_JOB_NUM_NODES": "4",
            "SLURM_CPUS_PER_TASK": "2",
            "SLURM_ARRAY_TASK_ID": "3",
        }
        file = folder / "script"
        file.write_text(script)
        self.process = subprocess.Popen(["/bin/bash", file], env=os.environ | known | environment, cwd=folder)

    def end(self, number=None):
        """Wait for the end, if need be by a signal, which comes when all that is held goes on; returns the code."""
        return self.process.wait(PATIENCE_S) if number is None else self._signalled(number)

    def _signalled(self, number):
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)

    def wait_for(self, *names):
        assert wait_until(lambda: all(Path(f"{self.calls_file}.{name}").exists() for name in names), PATIENCE_S)

    @property
    def calls(self):
        return self.calls_file.read_text().splitlines()


def asked(script):
    lines = [line.removeprefix("#SBATCH --") for line in script.splitlines() if line.startswith("#SBATCH ")]
    return dict(line.partition("=")[::2] for line in lines)


def test_what_slurm_is_asked_for_is_what_the_placement_needs(run, study):
    of_run = asked(run)
    assert (of_run["nodes"], of_run["cpus-per-task"], of_run["mem"]) == ("4", "2", "4608M")
    assert (asked(study)["array"], asked(study)["cpus-per-task"], asked(study)["mem"]) == ("1-8", "2", "4096M")
    for options in (of_run, asked(study)):
        assert (options["signal"], options["requeue"], options["open-mode"]) == ("B:USR1@180", "", "append")


def test_a_run_gets_keys_its_run_file_and_those_who_join(tmp_path, runs, run):
    bash = Bash(tmp_path, run)
    assert bash.end() == 0
    folder, host = runs / ".slurm-17", os.uname().nodename
    assert f"railctl keys create {folder}/keys --host {host}" in bash.calls
    assert (
        f"railctl up --file {folder}/run.yaml --name demo --listen tls/0.0.0.0:7447 --keys {folder}/keys" in bash.calls
    )
    [joins] = [call for call in bash.calls if call.startswith("srun ")]
    assert joins.startswith("srun --relative=1 --nodes=3 --ntasks=3 --cpus-per-task=2 ")
    assert joins.endswith(f"railctl join tls/{host}:7447 --keys {folder}/keys --actors easy=2 --wait 3600")
    written = yaml.safe_load(Path(f"{bash.calls_file}.run.yaml").read_text())
    assert written == {"lag": 3, "episodes": 30}
    assert list(runs.iterdir()) == []


@pytest.mark.parametrize(("number", "again"), [(signal.SIGTERM, []), (signal.SIGUSR1, ["scontrol requeue 17"])])
def test_a_run_that_is_told_to_end_ends_cleanly_and_comes_again_if_only_its_time_is_up(tmp_path, run, number, again):
    bash = Bash(tmp_path, run, HELD="yes")
    bash.wait_for("railctl", "srun")
    assert bash.end(number) == 1
    assert bash.calls[-2 - len(again) :] == ["railctl ended", "srun ended", *again]


def test_a_run_that_fails_fails_its_job_and_ends_those_who_joined(tmp_path, run, runs):
    bash = Bash(tmp_path, run.replace("up=(railctl", "up=(env HELD= CODE=2 railctl"), HELD="yes")
    assert bash.end() == 2
    assert not any("scontrol" in call for call in bash.calls)
    assert list(runs.iterdir()) == []


@pytest.mark.parametrize(("number", "again"), [(signal.SIGTERM, []), (signal.SIGUSR1, ["scontrol requeue 17"])])
def test_a_share_of_a_study_likewise(tmp_path, study, number, again):
    bash = Bash(tmp_path, study, HELD="yes")
    bash.wait_for("railctl")
    assert bash.end(number) == 1
    assert bash.calls == ["railctl study run my study.yaml --name mine --share 3/8 --cores 2", "railctl ended", *again]


def test_bash_takes_no_path_for_more_than_a_path(tmp_path):
    path = "/of/$(touch made)`touch made` \"$HOME\" 'it'\n/study.yaml"
    bash = Bash(tmp_path, study_script(StudyPlacement(path, "mine", 8, 2), tmp_path / "$(touch made)"))
    assert bash.end() == 0
    assert "\n".join(bash.calls) == f"railctl study run {path} --name mine --share 3/8 --cores 2"
    assert not (tmp_path / "made").exists()
