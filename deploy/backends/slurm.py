"""Slurm: a batch script for a run over the nodes of an allocation, and one for a study as an array of jobs.

What Slurm is asked for stands in `#SBATCH` lines, which options of `sbatch` go before. The rest of a script is a few
words of the plan, and shell that ships beside this module.
"""

import shlex
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from deploy.placement import Placement, StudyPlacement

STOPS_BEFORE_S = 180  # the time limit: a run ends within two minutes, or is killed


def run_script(placement: Placement, runs: Path) -> str:
    """The batch script of a run whose folder shall lie in `runs`, on a file system that all nodes share."""
    asked = {
        "job-name": placement.name,
        "nodes": placement.joining + 1,
        "ntasks-per-node": 1,
        "cpus-per-task": max(placement.host.cores, placement.joiner.cores),
        "mem": f"{max(placement.host.memory_mib, placement.joiner.memory_mib)}M",
        "output": f"{placement.name}-%j.log",
    }
    words = [
        f"export RAILCTL_RUNS={shlex.quote(str(runs))}",
        "folder=$RAILCTL_RUNS/.slurm-$SLURM_JOB_ID keys=$folder/keys host=$(hostname)",
        f"run_file={shlex.quote(placement.run_file)}",
        _array("up", placement.up("$folder/run.yaml", "$keys")),
        _array("join", placement.join("$host", "$keys", placement.actors)),
    ]
    return _script(asked, words, "slurm_run.sh")


def study_script(placement: StudyPlacement, runs: Path) -> str:
    """The batch script of a study whose folder shall lie in `runs`: an array of jobs, a share of its runs each."""
    asked = {
        "job-name": placement.name,
        "array": f"1-{placement.shares}",
        "ntasks": 1,
        "cpus-per-task": placement.size.cores,
        "mem": f"{placement.size.memory_mib}M",
        "output": f"{placement.name}-%A_%a.log",
    }
    words = [
        f"export RAILCTL_RUNS={shlex.quote(str(runs))}",
        _array("work", placement.run("$SLURM_ARRAY_TASK_ID")),
    ]
    return _script(asked, words, "slurm_study.sh")


def _script(asked: Mapping[str, object], words: Sequence[str], body: str) -> str:
    always = {"requeue": None, "open-mode": "append", "signal": f"B:USR1@{STOPS_BEFORE_S}"}
    lines = [f"#SBATCH --{key}" + ("" if value is None else f"={value}") for key, value in {**asked, **always}.items()]
    shell = [(files("deploy.backends") / name).read_text() for name in ("slurm.sh", body)]
    return "\n".join(["#!/bin/bash", *lines, "", *words, "", *shell])


def _array(name: str, words: Sequence[str]) -> str:
    """A command as an array of bash; `$` begins a variable of the script."""
    quoted = [f'"{word}"' if "$" in word else shlex.quote(word) for word in words]
    return f"{name}=({' '.join(quoted)})"
