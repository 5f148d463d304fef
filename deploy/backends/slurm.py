"""Slurm: a batch script for a run over the nodes of an allocation, and one for a study as an array of jobs.

What Slurm is asked for stands in `#SBATCH` lines, which options of `sbatch` go before. The rest of a script is a few
words of the plan, and shell that ships beside this module.
"""

import shlex
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from railctl.deploy.placement import Placement, StudyPlacement

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
        _array("up", placement.up(f"{_variable('folder')}/run.yaml", _variable("keys"))),
        _array("join", placement.join(_variable("host"), _variable("keys"), placement.actors)),
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
        _array("work", placement.run(_variable("SLURM_ARRAY_TASK_ID"))),
    ]
    return _script(asked, words, "slurm_study.sh")


def _script(asked: Mapping[str, object], words: Sequence[str], body: str) -> str:
    always = {"requeue": None, "open-mode": "append", "signal": f"B:USR1@{STOPS_BEFORE_S}"}
    lines = [f"#SBATCH --{key}" + ("" if value is None else f"={value}") for key, value in {**asked, **always}.items()]
    shell = [(files("railctl.deploy.backends") / name).read_text() for name in ("slurm.sh", body)]
    return "\n".join(["#!/bin/bash", *lines, "", *words, "", *shell])


def _variable(name: str) -> str:
    """Stands in a word for a variable of the script: between NULs, which nothing that users give can have."""
    return f"\0{name}\0"


def _array(name: str, words: Sequence[str]) -> str:
    """A command as an array of bash."""
    return f"{name}=({' '.join(map(_quoted, words))})"


def _quoted(word: str) -> str:
    """A word for bash, in which nothing but variables of the script means anything."""
    parts = enumerate(word.split("\0"))  # each second one is a variable
    return "".join(f'"${part}"' if number % 2 else shlex.quote(part) for number, part in parts if part)
