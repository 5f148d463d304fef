"""What the machine gives: cores, threads, open files, memory, disk, and its clock."""

import os
import resource
import shutil
import tempfile
import time
from pathlib import Path

from railctl.deploy.diagnosis.findings import Noted, Wrong
from railctl.deploy.plan import ENVIRONMENT
from railctl.deploy.runs import runs_root

GIB = 2**30
NEEDED_MEMORY_GIB = 3.0
NEEDED_DISK_GIB = 1.0
NEEDED_FILES = 256
TOLERATED_SKEW_S = 2.0
QUOTA = Path("/sys/fs/cgroup/cpu.max")  # of a container, in cgroup v2: microseconds of each period, and the period
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def cores() -> str:
    """On how many cores this process may run."""
    allowed, there = len(os.sched_getaffinity(0)), os.cpu_count() or 1
    granted = _quota()
    if granted is not None and granted < allowed:
        raise Noted(f"{allowed}, of whose time a container gets {granted:.1f}", "pass --cores, or give it more")
    if allowed == 1:
        raise Noted(f"1 of {there}", "runs work, at half the speed; taskset and containers take cores away")
    return f"{allowed}" if allowed == there else f"{allowed} of {there}"


def _quota() -> float | None:
    try:
        share, period = QUOTA.read_text().split()
        return None if share == "max" else int(share) / int(period)
    except (OSError, ValueError):
        return None


def threads() -> str:
    """Numerics get one thread a process, whatever the environment says."""
    other = [f"{name}={os.environ[name]}" for name in THREADS if os.environ.get(name, "1") != ENVIRONMENT[name]]
    if other:
        return f"one a process in runs; {' '.join(other)} of the environment holds elsewhere only"
    return "one a process"


def files() -> str:
    """How many files a process may have open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < NEEDED_FILES:
        raise Wrong(f"a process may open {soft}", f"ulimit -n {NEEDED_FILES * 4} in the shell that starts runs")
    return f"a process may open {'any number' if soft == resource.RLIM_INFINITY else soft}"


def memory() -> str:
    """Of the whole machine."""
    gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GIB
    if gib < NEEDED_MEMORY_GIB:
        raise Wrong(f"{gib:.1f} GiB", f"a run with two actors wants {NEEDED_MEMORY_GIB:g}: end other programs")
    return f"{gib:.1f} GiB"


def disk() -> str:
    """Where runs lie."""
    existing = _existing_folder()
    if not os.access(existing, os.W_OK):
        raise Wrong(f"{existing} cannot be written", "set RAILCTL_RUNS to a folder that can")
    gib = shutil.disk_usage(existing).free / GIB
    if gib < NEEDED_DISK_GIB:
        raise Wrong(
            f"{gib:.1f} GiB free in {existing}", f"a run wants {NEEDED_DISK_GIB:g}: make room, or set RAILCTL_RUNS"
        )
    return f"{gib:.0f} GiB free in {existing}"


def clock() -> str:
    """Whether the clock is that of the file system where runs lie, which may be another machine's."""
    try:
        with tempfile.TemporaryFile(dir=_existing_folder()) as file:
            file.write(b"now")
            file.flush()
            skew = time.time() - os.fstat(file.fileno()).st_mtime
    except OSError as error:
        raise Noted(
            f"cannot be compared: {error.strerror}", "set RAILCTL_RUNS to a folder that can be written"
        ) from None
    if abs(skew) > TOLERATED_SKEW_S:
        remedy = "set both by NTP: times in rows and of heartbeats come from several machines"
        raise Noted(f"{abs(skew):.0f} s {'ahead of' if skew > 0 else 'behind'} that of the folder of runs", remedy)
    return "that of the folder of runs"


def _existing_folder() -> Path:
    root = runs_root().absolute()
    return next(path for path in (root, *root.parents) if path.exists())
